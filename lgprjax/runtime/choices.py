"""Choices of the operator and one-time decisions of the run, kept in memory for a process that replaces a dead one."""

import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from lgprjax.run_records import Record, RecordKind, Source

_KEPT = ("route", "level", "anchor")
_STATES_A_SECOND = 10


class Choices:
    """Events of a run that hold until there is another one: the route and the level chosen, the anchor of the frame.

    Kept with the route: the place on it that the vehicle has come to.

    Args:
        rings: folder of the rings, in memory: it outlives every process, and no slow disk delays a tick.
    """

    def __init__(self, rings: Path) -> None:
        self._file = rings / "choices.json"
        self._kept: dict[str, Any] = {}
        self._states = 0
        with suppress(FileNotFoundError):
            self._kept = json.loads(self._file.read_text(encoding="utf-8"))

    def keep(self, out: list[Record]) -> None:
        """Keep choices among the records of a tick; once a second the place."""
        fresh: dict[str, Any] = {}
        for record in out:
            if record.kind is RecordKind.EVENT:
                told = json.loads(record.payload)
                fresh |= {name: told[name] for name in _KEPT if name in told}
                if "route" in told:
                    fresh["place"] = told.get("place")
            elif record.kind is RecordKind.STATE:
                self._states += 1
                told = json.loads(record.payload) if self._states % _STATES_A_SECOND == 0 else {}
                if told.get("place"):
                    fresh |= {name: told[name] for name in ("route", "place")}
        if fresh:
            self._kept |= fresh
            file = self._file.with_suffix(".new")
            file.write_text(json.dumps(self._kept), encoding="utf-8")
            file.replace(self._file)

    def again(self) -> list[Record]:
        """The operator's requests, to be repeated."""
        asked = [{f"select_{name}": self._kept[name]} for name in ("route", "level") if name in self._kept]
        if "route" in self._kept and self._kept.get("place"):
            asked[0]["place"] = self._kept["place"]
        at_ns = time.monotonic_ns()
        return [Record(RecordKind.REQUEST, Source.DISPLAY, 0, at_ns, json.dumps(each).encode()) for each in asked]

    @property
    def level(self) -> float | None:
        """The chosen level of confidence; ``None`` without one."""
        level: float | None = self._kept.get("level")
        return level

    @property
    def anchor(self) -> list[float] | None:
        """Latitude, longitude and height of the frame that positions of a run without a plan are in."""
        anchor: list[float] | None = self._kept.get("anchor")
        return anchor
