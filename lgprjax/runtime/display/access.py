"""Access to the page: checks of Host, Origin and token."""

import hashlib
import hmac
import ipaddress
import json
from collections import deque
from collections.abc import Iterable
from enum import Enum
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import urlsplit

from lgprjax.errors import InputError
from lgprjax.runtime.config import RuntimeConfig

COOKIE = "lgprjax_display"
_HTTP_PORT = 80

Headers = list[tuple[bytes, bytes]]


def is_loopback(host: str) -> bool:
    """Whether an address is reachable from this computer only; a name other than ``localhost`` counts as reachable."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class Access:
    """Access rules of requests.

    Args:
        config: configuration of the run; ``display`` is used.

    Raises:
        InputError: the address is reachable by others and there is no token, or an origin is invalid.
    """

    def __init__(self, config: RuntimeConfig) -> None:
        display = config.display
        if display.token is None and not is_loopback(display.host):
            raise InputError(
                config.file, "display.token", f"a token, because others can reach {display.host}", "no token"
            )
        self._origins = {_checked(config, origin) for origin in display.origins}
        self._host = display.host
        self._token = None if display.token is None else display.token.encode()

    def host_is_ours(self, headers: Headers, server: tuple[str, int | None] | None) -> bool:
        """Whether the Host header names this server: a page of another name that resolves to it does not.

        Args:
            headers: headers of the request.
            server: local address and port of its connection.
        """
        hosts = _values(headers, b"host")
        known = self._own(server) | {urlsplit(origin).netloc for origin in self._origins}
        return len(hosts) == 1 and hosts[0].lower() in known

    def origin_is_ours(self, headers: Headers, server: tuple[str, int | None] | None) -> bool:
        """Whether a browser's Origin is the page itself or a configured one; without one it is not."""
        origins = _values(headers, b"origin")
        if len(origins) != 1:
            return False
        own = {f"http://{name}" for name in self._own(server)}
        return origins[0].lower() in own | self._origins

    def is_let_in(self, headers: Headers) -> bool:
        """Whether the token is not needed, or is given as ``Authorization: Bearer`` or as the page's cookie."""
        if self._token is None:
            return True
        bearers = [value[7:] for value in _values(headers, b"authorization") if value[:7].lower() == "bearer "]
        return any(self.token_is_right(bearer) for bearer in bearers) or any(
            hmac.compare_digest(value.encode("latin-1", "replace"), self.cookie().encode())
            for value in _cookies(headers)
        )

    def token_is_right(self, token: str) -> bool:
        """Whether a token is the configured one, in constant time."""
        return self._token is not None and hmac.compare_digest(token.encode("utf-8", "replace"), self._token)

    def cookie(self) -> str:
        """Cookie instead of the token; unchanged after a restart of the display."""
        return hmac.new(self._token or b"", b"lgprjax.display", hashlib.sha256).hexdigest()

    def _own(self, server: tuple[str, int | None] | None) -> set[str]:
        address, port = server or ("", None)
        names = {_bracketed(address), _bracketed(self._host)} | ({"localhost"} if is_loopback(address) else set())
        own = {f"{name}:{port}" for name in names} | (names if port == _HTTP_PORT else set())
        return {name.lower() for name in own}


def _checked(config: RuntimeConfig, origin: str) -> str:
    parts = urlsplit(origin)
    if parts.scheme not in ("http", "https") or origin != f"{parts.scheme}://{parts.netloc}" or not parts.netloc:
        raise InputError(config.file, "display.origins", "origins such as http://10.0.0.5:8080", repr(origin))
    return origin.lower()


def _bracketed(address: str) -> str:
    return f"[{address}]" if ":" in address else address


def _values(headers: Headers, name: bytes) -> list[str]:
    return [value.decode("latin-1") for key, value in headers if key.lower() == name]


def _cookies(headers: Headers) -> Iterable[str]:
    for value in _values(headers, b"cookie"):
        try:
            cookie = SimpleCookie(value).get(COOKIE)
        except CookieError:
            continue
        if cookie is not None:
            yield cookie.value


# Messages of a page over its websocket: requests for another route, another place on it, or a level of confidence.

LARGEST_BYTES = 1024
MOST_A_SECOND = 5
LONGEST_NAME = 200
_WANTED = ({"select_route"}, {"select_route", "place"}, {"select_level"})
Wanted = dict[str, Any]
"""A request: names, or a level of confidence."""
_LARGEST_NUMBER = 2**53  # largest exact integer of a browser


class Refused(Enum):
    """Why a message is refused."""

    TOO_MANY = "more than five messages a second"
    TOO_LARGE = "a message above 1 kB"
    NOT_TEXT = "a message that is not text"
    NOT_JSON = "a message that is not JSON"
    NOT_A_REQUEST = "a message that is no known request"
    SESSION = "a message of another session"
    REPEATED = "a message that was sent before"


class RequestGate:
    """Accepts requests among a connection's messages: each at most once, in order, and for this connection.

    Args:
        session: the server's identifier at its start.
    """

    def __init__(self, session: str) -> None:
        self._session = session
        self._number = 0
        self._times: deque[int] = deque(maxlen=MOST_A_SECOND)

    def judge(self, message: str | bytes | None, mono_ns: int) -> Wanted | Refused:
        """The request in a message, or the reason of its refusal.

        A route, ``select_route``, with the ``place`` on it if given; or a level of confidence, ``select_level``.

        Args:
            message: text; bytes are refused.
            mono_ns: monotonic time of its arrival.
        """
        crowded = len(self._times) == MOST_A_SECOND and mono_ns - self._times[0] < 1_000_000_000
        self._times.append(mono_ns)
        if crowded:
            return Refused.TOO_MANY
        if not isinstance(message, str):
            return Refused.NOT_TEXT
        if len(message.encode("utf-8", "replace")) > LARGEST_BYTES:
            return Refused.TOO_LARGE
        try:
            said = json.loads(message, object_pairs_hook=_unique, parse_constant=_no_number)
        except (ValueError, RecursionError):
            return Refused.NOT_JSON
        return self._request(said)

    def _request(self, said: Any) -> Wanted | Refused:
        if not isinstance(said, dict) or said.keys() - {"session", "number"} not in _WANTED:
            return Refused.NOT_A_REQUEST
        wanted: Wanted = {key: value for key, value in said.items() if key not in ("session", "number")}
        session, number = said.get("session"), said.get("number")
        if type(session) is not str or type(number) is not int or not 0 < number < _LARGEST_NUMBER:
            return Refused.NOT_A_REQUEST
        if any(type(value) is not (float if key == "select_level" else str) for key, value in wanted.items()):
            return Refused.NOT_A_REQUEST
        if any(isinstance(value, str) and not 0 < len(value) <= LONGEST_NAME for value in wanted.values()):
            return Refused.NOT_A_REQUEST
        if session != self._session:
            return Refused.SESSION
        if number <= self._number:
            return Refused.REPEATED
        self._number = number
        return wanted


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = dict(pairs)
    if len(names) != len(pairs):
        raise ValueError("a duplicate key")
    return names


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant} is not JSON")
