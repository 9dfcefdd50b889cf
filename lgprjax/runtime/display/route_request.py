"""What a page may say over its websocket: that another route is wanted, and nothing else."""

import json
from collections import deque
from enum import Enum
from typing import Any

LARGEST_BYTES = 1024
MOST_A_SECOND = 5
LONGEST_NAME = 200
_KEYS = {"session", "number", "select_route"}
_LARGEST_NUMBER = 2**53  # beyond it a browser counts no longer


class Refused(Enum):
    """Why a message asks for nothing."""

    TOO_MANY = "more than five messages a second"
    TOO_LARGE = "a message above 1 kB"
    NOT_TEXT = "a message that is no text"
    NOT_JSON = "a message that is no JSON"
    NOT_A_REQUEST = "a message that is no request for a route"
    SESSION = "a message of another session"
    REPEATED = "a message that was sent before"


class RequestGate:
    """What of one connection's messages is a request: each at most once, in order, made for this connection.

    Args:
        session: what the server said at its beginning.
    """

    def __init__(self, session: str) -> None:
        self._session = session
        self._number = 0
        self._times: deque[int] = deque(maxlen=MOST_A_SECOND)

    def judge(self, message: str | bytes | None, mono_ns: int) -> str | Refused:
        """The name of the route that a message asks for, or why it asks for none.

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

    def _request(self, said: Any) -> str | Refused:
        if not isinstance(said, dict) or said.keys() != _KEYS:
            return Refused.NOT_A_REQUEST
        session, number, name = said["session"], said["number"], said["select_route"]
        if type(session) is not str or type(number) is not int or type(name) is not str:
            return Refused.NOT_A_REQUEST
        if not 0 < len(name) <= LONGEST_NAME or not 0 < number < _LARGEST_NUMBER:
            return Refused.NOT_A_REQUEST
        if session != self._session:
            return Refused.SESSION
        if number <= self._number:
            return Refused.REPEATED
        self._number = number
        return name


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = dict(pairs)
    if len(names) != len(pairs):
        raise ValueError("a key stands twice")
    return names


def _no_number(constant: str) -> float:
    raise ValueError(f"{constant} is no JSON")
