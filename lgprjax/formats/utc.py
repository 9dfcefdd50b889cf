"""Moments: ISO 8601 texts of files, and whole nanoseconds of Unix time."""

from datetime import UTC, datetime, timedelta

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


def utc_ns(text: str) -> int:
    """Nanoseconds of Unix time of a moment; one without a zone is UTC. Raises ``ValueError`` for what is none."""
    moment = datetime.fromisoformat(text)
    moment = moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def utc_text(ns: int) -> str:
    """The moment as files have it, to the microsecond. Raises ``OverflowError`` beyond the calendar."""
    return (_EPOCH + timedelta(microseconds=ns // 1000)).isoformat().replace("+00:00", "Z")
