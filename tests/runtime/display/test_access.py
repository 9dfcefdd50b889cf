"""Who may see the page: Host, Origin, token."""

import pytest

from lgprjax.runtime.display.access import COOKIE, Access, is_loopback
from refusals import refused
from runtime.display.display_config import TOKEN, config_with

HERE = ("127.0.0.1", 8080)
CAR = ("10.0.0.5", 8080)


def header(name: str, value: str) -> list[tuple[bytes, bytes]]:
    return [(name.encode(), value.encode("latin-1"))]


def test_loopback_needs_no_token_and_any_other_address_demands_one() -> None:
    for host in ("127.0.0.1", "127.9.9.9", "::1", "localhost"):
        assert is_loopback(host)
        Access(config_with(host=host))
    for host in ("0.0.0.0", "::", "10.0.0.5", "localhost.example.org", "vehicle", ""):
        with refused("display.token", file="CONFIG.toml"):
            Access(config_with(host=host))
        assert not Access(config_with(host=host, token=TOKEN)).is_let_in([])


@pytest.mark.parametrize("origin", ["vehicle", "ftp://vehicle", "http://vehicle/page", "null"])
def test_an_origin_that_is_none(origin: str) -> None:
    with refused("display.origins", found=origin):
        Access(config_with(origins=[origin]))


def test_host() -> None:
    access = Access(config_with())
    for ours in ("127.0.0.1:8080", "localhost:8080", "LOCALHOST:8080"):
        assert access.host_is_ours(header("host", ours), HERE)
    others = ("127.0.0.1", "127.0.0.1:8081", "evil.example:8080", "127.0.0.1.evil.example:8080", "")
    for other in (*others, "localhost:8080@evil.example"):
        assert not access.host_is_ours(header("host", other), HERE), other


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


def test_origin() -> None:
    access = Access(config_with(origins=["https://car.example"]))
    for ours in ("http://127.0.0.1:8080", "http://localhost:8080", "https://car.example"):
        assert access.origin_is_ours(header("origin", ours), HERE)
    others = ("https://127.0.0.1:8080", "http://127.0.0.1:9090", "http://car.example", "http://evil.example")
    for other in (*others, "https://car.example.evil.example", "null", ""):
        assert not access.origin_is_ours(header("origin", other), HERE), other
    assert not access.origin_is_ours([], HERE)


def test_token_by_bearer_or_cookie() -> None:
    access = Access(config_with(token=TOKEN))
    assert access.is_let_in(header("authorization", f"Bearer {TOKEN}"))
    assert access.is_let_in(header("cookie", f"a=b; {COOKIE}={access.cookie()}"))
    assert TOKEN not in access.cookie()
    assert Access(config_with(token=TOKEN)).cookie() == access.cookie()
    assert Access(config_with(token=TOKEN + "!")).cookie() != access.cookie()


def test_wrong_token() -> None:
    wrong = [
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
    ]
    for name, value in wrong:
        assert not Access(config_with(token=TOKEN)).is_let_in(header(name, value)), value
    # Without a token none is right.
    access = Access(config_with())
    assert access.is_let_in([])
    assert not access.token_is_right("")
