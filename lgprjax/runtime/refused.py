"""Bytes that came over a line and are not to be acted upon, and why."""

from enum import IntEnum
from typing import NamedTuple

KEPT = 64
"""Bytes that are kept of what was refused."""


class Reason(IntEnum):
    """Why bytes are no message. ``link.Verdict`` goes on from 32: why a whole frame is refused."""

    NO_SYNC = 1
    """No message begins here."""
    VERSION = 2
    """Of a protocol that is not known."""
    LENGTH = 3
    """Longer than allowed, or not as long as such a message is."""
    CRC = 4
    """The CRC or checksum is not that of the bytes."""
    TYPE = 5
    """A whole frame whose message is not known."""
    PAYLOAD = 6
    """A whole frame whose payload contradicts itself."""
    CUT = 7
    """A sentence that breaks off, or has no checksum."""


class Refused(NamedTuple):
    """What was refused.

    Attributes:
        reason: a ``Reason``, or a ``link.Verdict``.
        data: the first ``KEPT`` bytes.
    """

    reason: int
    data: bytes
