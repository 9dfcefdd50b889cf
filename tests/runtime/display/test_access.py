"""Who may see the page: Host, Origin, token."""

import pytest

from lgprjax.errors import InputError
from lgprjax.runtime.display.access import COOKIE, Access, is_loopback
from runtime.display.display_config import TOKEN, config_with

HERE = ("127.0.0.1", 8080)
CAR = ("10.0.0.5", 8080)


def header(name: str, value: str) -> list[tuple[bytes, bytes]]:
    return [(name.encode(), value.encode("latin-1"))]


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "::1", "localhost"])
def test_nobody_reaches_loopback(host: str) -> None:
    assert is_loopback(host)
    Access(config_with(host=host))


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "10.0.0.5", "localhost.example.org", "vehicle", ""])
def test_any_other_address_demands_a_token(host: str) -> None:
    with pytest.raises(InputError, match=r"^CONFIG\.toml: display\.token: expected a token") as caught:
        Access(config_with(host=host))
    assert caught.value.place == "display.token"
    assert caught.value.file == "CONFIG.toml"
    assert not Access(config_with(host=host, token=TOKEN)).is_let_in([])


@pytest.mark.parametrize("origin", ["vehicle", "ftp://vehicle", "http://", "http://vehicle/page", "http://v/", "null"])
def test_an_origin_that_is_none(origin: str) -> None:
    with pytest.raises(InputError) as caught:
        Access(config_with(origins=[origin]))
    assert caught.value.place == "display.origins"


@pytest.mark.parametrize(
    ("host", "ours"),
    [
        ("127.0.0.1:8080", True),
        ("localhost:8080", True),
        ("LOCALHOST:8080", True),
        ("127.0.0.1", False),
        ("127.0.0.1:8081", False),
        ("evil.example:8080", False),
        ("127.0.0.1.evil.example:8080", False),
        ("localhost:8080@evil.example", False),
        ("", False),
    ],
)
def test_host(host: str, *, ours: bool) -> None:
    assert Access(config_with()).host_is_ours(header("host", host), HERE) is ours


def test_host_of_a_vehicle_in_a_network() -> None:
    access = Access(config_with(host="0.0.0.0", token=TOKEN, origins=["https://car.example"]))
    assert access.host_is_ours(header("host", "10.0.0.5:8080"), CAR)
    assert access.host_is_ours(header("host", "car.example"), CAR)
    assert not access.host_is_ours(header("host", "localhost:8080"), CAR)
    assert not access.host_is_ours(header("host", "other.example:8080"), CAR)


def test_two_hosts_or_none_are_refused() -> None:
    access = Access(config_with())
    assert not access.host_is_ours([], HERE)
    assert not access.host_is_ours(header("host", "127.0.0.1:8080") * 2, HERE)


def test_port_80_need_not_be_told() -> None:
    access = Access(config_with())
    assert access.host_is_ours(header("host", "127.0.0.1"), ("127.0.0.1", 80))
    assert access.origin_is_ours(header("origin", "http://localhost"), ("127.0.0.1", 80))


def test_ipv6_stands_in_brackets() -> None:
    access = Access(config_with(host="::1"))
    assert access.host_is_ours(header("host", "[::1]:8080"), ("::1", 8080))
    assert access.origin_is_ours(header("origin", "http://[::1]:8080"), ("::1", 8080))


@pytest.mark.parametrize(
    ("origin", "ours"),
    [
        ("http://127.0.0.1:8080", True),
        ("http://localhost:8080", True),
        ("https://car.example", True),
        ("https://127.0.0.1:8080", False),
        ("http://127.0.0.1:9090", False),
        ("http://car.example", False),
        ("https://car.example.evil.example", False),
        ("http://evil.example", False),
        ("null", False),
        ("", False),
    ],
)
def test_origin(origin: str, *, ours: bool) -> None:
    access = Access(config_with(origins=["https://car.example"]))
    assert access.origin_is_ours(header("origin", origin), HERE) is ours


def test_no_origin_is_no_own_origin() -> None:
    assert not Access(config_with()).origin_is_ours([], HERE)


def test_token_by_bearer_or_cookie() -> None:
    access = Access(config_with(token=TOKEN))
    assert access.is_let_in(header("authorization", f"Bearer {TOKEN}"))
    assert access.is_let_in(header("cookie", f"a=b; {COOKIE}={access.cookie()}"))
    assert TOKEN not in access.cookie()
    assert Access(config_with(token=TOKEN)).cookie() == access.cookie()
    assert Access(config_with(token=TOKEN + "!")).cookie() != access.cookie()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("authorization", f"Bearer {TOKEN}x"),
        ("authorization", f"Bearer {TOKEN[:-1]}"),
        ("authorization", "Bearer "),
        ("authorization", "Bearer Ü\xff"),
        ("authorization", f"Basic {TOKEN}"),
        ("authorization", TOKEN),
        ("cookie", f"{COOKIE}={TOKEN}"),
        ("cookie", f"{COOKIE}="),
        ("cookie", f"{COOKIE}=\xff\xfe"),
        ("cookie", f"other={TOKEN}"),
        ("cookie", "=;=;;;\x00"),
    ],
)
def test_wrong_token(name: str, value: str) -> None:
    assert not Access(config_with(token=TOKEN)).is_let_in(header(name, value))


def test_without_a_token_none_is_right() -> None:
    access = Access(config_with())
    assert access.is_let_in([])
    assert not access.token_is_right("")
