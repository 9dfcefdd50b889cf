"""The served page as its visitors meet it: files, headers, who is refused, and what a visitor may ask for."""

import json
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from lgprjax.runtime.display import pages
from lgprjax.runtime.display.access import COOKIE, Refused
from lgprjax.runtime.display.pages import MOST_VIEWERS
from lgprjax.runtime.ring import Ring
from runtime.display.display_config import TOKEN
from runtime.display.served_page import BROKEN, READY, ServedPage, serve


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedPage]:
    with serve(tmp_path_factory.mktemp("display")) as served:
        served.show(READY)
        yield served


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedPage]:
    with serve(tmp_path_factory.mktemp("display"), f'token = "{TOKEN}"') as served:
        served.show(READY)
        yield served


@pytest.fixture
def browser(page: ServedPage) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=page.url, trust_env=False) as client:
        yield client


def socket_of(served: ServedPage, headers: dict[str, str] | None = None) -> ClientConnection:
    """A websocket with the page's own Origin, or with these headers instead."""
    sent = {"Origin": f"http://{served.host}"} if headers is None else headers
    return connect(f"ws://{served.host}/socket", additional_headers=sent, proxy=None)


def status_of_socket(served: ServedPage, headers: dict[str, str]) -> int:
    with pytest.raises(InvalidStatus) as caught:
        socket_of(served, headers)
    return caught.value.response.status_code


def hello(socket: ClientConnection) -> str:
    said = json.loads(socket.recv(5.0))
    assert said["kind"] == "hello"
    return str(said["session"])


def answer(socket: ClientConnection) -> str | None:
    while True:
        said = json.loads(socket.recv(5.0))
        if said["kind"] == "answer":
            refused: str | None = said["refused"]
            return refused


def code_of_close(socket: ClientConnection) -> int | None:
    """Why the server closes; what it says before is let go."""
    with suppress(ConnectionClosed):
        while True:
            socket.recv(5.0)
    return socket.close_code


def refused_in_all(socket: ClientConnection) -> int:
    while True:
        said = json.loads(socket.recv(5.0))
        if said["kind"] == "state":
            return int(said["refused"])


@pytest.mark.parametrize("path", ["/", "/display.js", "/nowhere", "/page/display.js"])
def test_every_answer_has_its_headers(page: ServedPage, browser: httpx.Client, path: str) -> None:
    found = browser.get(path)
    assert found.status_code == (404 if path in ("/nowhere", "/page/display.js") else 200)
    assert found.headers["cache-control"] == "no-store"
    assert found.headers["x-frame-options"] == "DENY"
    assert found.headers["x-content-type-options"] == "nosniff"
    assert "server" not in found.headers
    policy = dict(part.split(" ", 1) for part in found.headers["content-security-policy"].split("; "))
    assert policy["default-src"] == policy["frame-ancestors"] == policy["form-action"] == "'none'"
    assert policy["script-src"] == policy["style-src"] == "'self'"
    assert policy["connect-src"] == f"'self' ws://{page.host}"


def test_the_page_names_no_other_host_and_inserts_no_markup() -> None:
    folder = Path(pages.__file__).parent / "page"
    text = "".join(path.read_text(encoding="utf-8") for path in folder.iterdir())
    assert not [
        word for word in ("http:", "https://", "innerHTML", "insertAdjacent", "eval(", "Storage") if word in text
    ]


@pytest.mark.parametrize(("method", "path"), [("POST", "/"), ("PUT", "/socket"), ("ENGAGE", "/engage")])
def test_there_is_nothing_but_to_look_at(page: ServedPage, browser: httpx.Client, method: str, path: str) -> None:
    own = {"origin": f"http://{page.host}"}
    assert browser.request(method, path, headers=own, json={"select_route": "quarry"}).status_code == 405
    assert browser.request(method, path, headers={"origin": "http://evil.example"}).status_code == 403
    assert browser.request(method, path).status_code == 403
    assert page.requests() == []


def test_another_name_for_this_address(page: ServedPage, browser: httpx.Client) -> None:
    rebound = {"Host": f"evil.example:{page.port}", "Origin": f"http://evil.example:{page.port}"}
    assert browser.get("/", headers=rebound).status_code == 421
    # The last Host header is one too many: the library adds its own.
    assert status_of_socket(page, rebound) in (400, 403)
    assert browser.get("/", headers={"Host": f"localhost:{page.port}"}).status_code == 200


def test_another_origin_gets_no_socket(page: ServedPage) -> None:
    for headers in ({}, {"Origin": "http://evil.example"}, {"Origin": "null"}):
        assert status_of_socket(page, headers) == 403


def test_token_once_then_cookie(guarded: ServedPage) -> None:
    with httpx.Client(base_url=guarded.url, trust_env=False) as browser:
        assert browser.get("/").status_code == 401
        assert browser.get("/display.js").status_code == 401
        for wrong in ("", "x" * 28, TOKEN[:-1], TOKEN + "x", "%ff%fe"):
            assert browser.get(f"/?token={wrong}").status_code == 401
        assert browser.get(f"/?token={TOKEN}&token={TOKEN}").status_code == 401
        assert browser.get(f"/display.js?token={TOKEN}").status_code == 401
        assert not browser.cookies
        given = browser.get("/", params={"token": TOKEN})
        assert (given.status_code, given.headers["location"]) == (303, "/")
        assert TOKEN not in given.headers["set-cookie"]
        attributes = {part.strip().lower() for part in given.headers["set-cookie"].split(";")}
        assert {"httponly", "samesite=strict", "path=/"} <= attributes
        assert browser.get("/").status_code == 200
        cookie = f"{COOKIE}={browser.cookies[COOKIE]}"
    with socket_of(guarded, {"Origin": f"http://{guarded.host}", "Cookie": cookie}) as socket:
        hello(socket)


def test_a_wrong_token_gets_no_socket(guarded: ServedPage) -> None:
    own = {"Origin": f"http://{guarded.host}"}
    for extra in ({}, {"Cookie": f"{COOKIE}={TOKEN}"}, {"Authorization": "Bearer wrong"}):
        assert status_of_socket(guarded, own | extra) == 403


def test_a_request_reaches_the_ring_once(page: ServedPage) -> None:
    with socket_of(page) as socket:
        session = hello(socket)
        before = refused_in_all(socket)
        wish: dict[str, Any] = {"session": session, "number": 1, "select_route": "quarry"}
        socket.send(json.dumps(wish))
        assert answer(socket) is None
        socket.send(json.dumps(wish))
        assert answer(socket) == Refused.REPEATED.value
        socket.send(json.dumps(wish | {"number": 2, "select_route": "old road"}))
        assert BROKEN["problem"] in str(answer(socket))
        assert refused_in_all(socket) == before + 2
    assert page.requests() == [{"select_route": "quarry"}]
    with socket_of(page) as socket:
        assert hello(socket) != session
        socket.send(json.dumps(wish | {"number": 2}))
        assert answer(socket) == Refused.SESSION.value
    assert page.requests() == []


def test_who_goes_on_is_closed(page: ServedPage) -> None:
    with socket_of(page) as socket:
        hello(socket)
        for _ in range(10):
            socket.send('{"engage": true}')
        assert code_of_close(socket) == 1008
    assert page.requests() == []


def test_a_large_message_ends_the_line(page: ServedPage) -> None:
    with socket_of(page) as socket:
        hello(socket)
        socket.send("x" * 1025)
        assert code_of_close(socket) == 1009


def test_a_full_ring_is_told(page: ServedPage) -> None:
    ring = Ring(page.folder / "requests")
    while ring.put(bytes(64)):
        pass
    with socket_of(page) as socket:
        session = hello(socket)
        socket.send(json.dumps({"session": session, "number": 1, "select_route": "quarry"}))
        assert answer(socket) is not None
    assert ring.lost > 0
    ring.take()


def test_one_viewer_too_many(page: ServedPage) -> None:
    with ExitStack() as opened:
        sockets = [opened.enter_context(socket_of(page)) for _ in range(MOST_VIEWERS)]
        for socket in sockets:
            hello(socket)
        with socket_of(page) as last:
            assert code_of_close(last) == 1013
        sockets[0].close()
        with socket_of(page) as again:
            hello(again)
