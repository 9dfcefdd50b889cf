"""State of the display: the newest state of the control process, its age, and the path."""

import json
from typing import Any

from lgprjax.run_records import RecordKind, unpack
from lgprjax.runtime.display.access import Wanted
from lgprjax.runtime.radargram import LiveColumns

STALE_NS = 500_000_000
_SHAPE_OLD_NS = 1_500_000_000
ENGAGED = ("STEERING", "SPEED")


class Board:
    """The newest state.

    Attributes:
        path_version: changes with the path; worked_version: changes with the worked map.
        refused_states: invalid messages of the control process.
    """

    def __init__(self) -> None:
        self.path_version = self.worked_version = 0
        self.refused_states = 0
        self._state: dict[str, Any] | None = None
        self._state_ns = 0
        self._path: list[Any] | None = None
        self._worked: dict[str, Any] | None = None
        self._shape: dict[str, Any] | None = None
        self._shape_ns = 0
        self._columns = LiveColumns()
        self._column: list[int] | None = None

    def take(self, messages: list[bytes]) -> None:
        """Take messages of the control process, oldest first."""
        for message in messages:
            try:
                record = unpack(message)
                state = json.loads(record.payload, parse_constant=_nothing)
                if record.kind is not RecordKind.STATE or not isinstance(state, dict):
                    raise ValueError("no state")
                # A number too large for a browser, such as 1e999, is detected here.
                json.dumps(state, allow_nan=False)
            except (ValueError, RecursionError):
                self.refused_states += 1
                continue
            self._show(state, record.mono_ns)

    def take_worked(self, messages: list[bytes]) -> None:
        """Take messages of the coverage process, oldest first: the map, or the tool's shape."""
        for message in messages:
            try:
                record = unpack(message)
                told = json.loads(record.payload, parse_constant=_nothing)
                if not isinstance(told, dict):
                    raise ValueError("no map of worked ground")
                json.dumps(told, allow_nan=False)
            except (ValueError, RecursionError):
                self.refused_states += 1
                continue
            if "shape" in told:
                self._shape, self._shape_ns = told, record.mono_ns
            else:
                self._worked = told
                self.worked_version += 1

    def take_scans(self, messages: list[bytes]) -> None:
        """Take the radar's scans, oldest first; the newest one becomes the next column of the radargram."""
        for message in messages:
            try:
                self._columns.take(unpack(message).payload)
            except ValueError:
                self.refused_states += 1
        column = self._columns.column()
        self._column = None if column is None else column.tolist()

    def text(self, mono_ns: int, refused: int, *, with_path: bool, with_worked: bool = False) -> str:
        """The message to a page.

        Args:
            mono_ns: monotonic time now.
            refused: requests refused since the display started.
            with_path: the page does not have this path yet; with_worked: nor the worked map.
        """
        said: dict[str, Any] = {
            "kind": "state",
            "sent_s": mono_ns * 1e-9,
            "age_s": None if self._state is None else (mono_ns - self._state_ns) * 1e-9,
            "refused": refused,
            "state": self._state,
        }
        if self._column is not None:
            said["column"] = self._column
        if self._shape is not None and mono_ns - self._shape_ns < _SHAPE_OLD_NS:
            said["shape"] = self._shape
        if with_path:
            said["path"] = self._path
        if with_worked:
            said["worked"] = self._worked
        return json.dumps(said, allow_nan=False, separators=(",", ":"))

    def obstacle(self, wanted: Wanted, mono_ns: int) -> str | None:
        """Reason why a request is impossible now; ``None`` if it is possible. The control process decides again.

        Args:
            wanted: request of the page; see ``RequestGate.judge``.
            mono_ns: present monotonic time, ns.
        """
        if self._state is None or mono_ns - self._state_ns > STALE_NS:
            return "no data from the vehicle"
        if "select_level" in wanted:
            levels = {} if self._worked is None else self._worked.get("levels")
            return None if isinstance(levels, list) and wanted["select_level"] in levels else "no such level"
        mode = self._state.get("mode")
        if not isinstance(mode, str) or mode in ENGAGED:
            return "routes are chosen before automatic steering"
        routes = self._state.get("routes")
        for route in routes if isinstance(routes, list) else []:
            if isinstance(route, dict) and route.get("name") == wanted["select_route"]:
                return None if route.get("problem") is None else f"the route cannot be driven: {route['problem']}"
        return "no such route"

    def _show(self, state: dict[str, Any], mono_ns: int) -> None:
        path = state.pop("path", None)
        changed = self._state is None or self._state.get("route") != state.get("route")
        if isinstance(path, list) or changed:
            # The path of another route is never shown, not even until the new one comes.
            new = path if isinstance(path, list) else None
            if new != self._path:
                self._path = new
                self.path_version += 1
        self._state, self._state_ns = state, mono_ns


def _nothing(constant: str) -> None:
    """NaN and infinities are not JSON for a browser: shown as missing."""
    del constant
