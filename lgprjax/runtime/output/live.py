"""The live view: scene, position, radargram and modes over Foxglove's websocket protocol."""

import contextlib
import json
from collections import deque
from importlib.util import find_spec
from typing import Any

import numpy as np
from jaxtyping import Shaped

from lgprjax.errors import InputError
from lgprjax.frames import LocalFrame
from lgprjax.run_records import unpack
from lgprjax.runtime.output.nmea import Given, horizontal_covariance
from lgprjax.runtime.process import Started
from lgprjax.runtime.radargram import middle_trace
from lgprjax.wire import decode

_KEPT_SCANS = 512
_IMAGE_EVERY = 25  # scans
_MODES = {
    "type": "object",
    "properties": {
        "mode": {"type": "string"},
        "speed_mps": {"type": "number"},
        "cross_track_m": {"type": "number"},
        "to_go_m": {"type": "number"},
        "correlation": {"type": "number"},
        "cause": {"type": "string"},
        "warnings": {"type": "array", "items": {"type": "string"}},
    },
}


class LiveView:
    """A server of Foxglove's websocket protocol.

    Args:
        started: arguments of the process; rings ``view_state`` and ``view_scans`` are used.
        frame: frame of the map.

    Raises:
        InputError: the package of the extra live is missing, or the address cannot be listened at.
    """

    def __init__(self, started: Started, frame: LocalFrame) -> None:
        table = started.config.output
        assert table is not None
        if find_spec("foxglove") is None:
            extra = 'the package of the extra live (pip install "lgprjax[live]")'
            raise InputError(started.config.file, "output.live_port", extra, "none")
        import foxglove

        self._frame = frame
        self._states, self._scans = started.ring("view_state"), started.ring("view_scans")
        self._traces: deque[np.ndarray] = deque(maxlen=_KEPT_SCANS)
        self._fresh = 0
        self._path: list[list[float]] = []
        # A viewer's connection would be logged through Python by a thread that holds the SDK's lock, while this one
        # waits for that lock and holds the interpreter's: neither would ever go on.
        foxglove.set_log_level("CRITICAL")
        try:
            self._server = foxglove.start_server(name="lgprjax", host=table.live_host, port=table.live_port)
        except (OSError, RuntimeError) as error:
            found = f"{table.live_host}:{table.live_port}: {error}"
            raise InputError(started.config.file, "output.live_port", "an address to listen at", found) from None
        schema: dict[str, Any] = {**_MODES}
        self._modes = foxglove.Channel("/modes", schema=schema)

    def step(self) -> None:
        """Show what came."""
        for message in self._states.take():
            with contextlib.suppress(ValueError):
                self._show_state(json.loads(unpack(message).payload))
        for message in self._scans.take():
            with contextlib.suppress(ValueError):
                self._take_scan(unpack(message).payload)

    def place(self, given: Given, row: Shaped[np.ndarray, ""] | np.void) -> None:
        """Show a position."""
        from foxglove import log, messages

        if given.quality == 0 or not np.all(np.isfinite(given[1:7])):
            return
        ee, en, nn = horizontal_covariance(given)
        fix = messages.LocationFix(
            frame_id="map",
            latitude=given.latitude_deg,
            longitude=given.longitude_deg,
            altitude=given.height_m,
            position_covariance=[ee, en, 0.0, en, nn, 0.0, 0.0, 0.0, 1.0],
            position_covariance_type=messages.LocationFixPositionCovarianceType.Approximated,
        )
        log("/position", fix)
        x, y, yaw = (float(value) for value in row["pose"])
        turned = messages.Quaternion(x=0.0, y=0.0, z=float(np.sin(0.5 * yaw)), w=float(np.cos(0.5 * yaw)))
        pose = messages.Pose(position=messages.Vector3(x=x, y=y, z=0.0), orientation=turned)
        log("/pose", messages.PoseInFrame(frame_id="map", pose=pose))

    def close(self) -> None:
        """Disconnect all viewers."""
        self._server.stop()

    def _show_state(self, state: dict[str, Any]) -> None:
        if isinstance(state.get("path"), list):
            self._path = state["path"]
            self._show_path()
        self._modes.log({name: state.get(name) for name in _MODES["properties"]})

    def _show_path(self) -> None:
        from foxglove import log, messages

        points = [messages.Point3(x=float(x), y=float(y), z=0.0) for x, y in self._path]
        line = messages.LinePrimitive(
            type=messages.LinePrimitiveLineType.LineStrip,
            thickness=0.1,
            points=points,
            color=messages.Color(r=0.0, g=0.3, b=0.7, a=1.0),
        )
        entity = messages.SceneEntity(frame_id="map", id="route", lines=[line])
        log("/scene", messages.SceneUpdate(entities=[entity]))

    def _take_scan(self, raw: bytes) -> None:
        trace = middle_trace(decode(raw))
        if self._traces and len(trace) != len(self._traces[-1]):
            self._traces.clear()
        self._traces.append(trace)
        self._fresh += 1
        if self._fresh >= _IMAGE_EVERY:
            self._fresh = 0
            self._show_radargram()

    def _show_radargram(self) -> None:
        from foxglove import log, messages

        image = np.stack(list(self._traces), axis=1)
        # The constant part of all scans hides the ground.
        image = image - image.mean(axis=1, keepdims=True)
        scale = 3.0 * float(np.sqrt(np.mean(image**2))) + 1e-30
        grey = np.clip(127.5 + 127.5 * image / scale, 0.0, 255.0).astype(np.uint8)
        height, width = grey.shape
        log(
            "/radargram",
            messages.RawImage(
                frame_id="radar", width=width, height=height, encoding="mono8", step=width, data=grey.tobytes()
            ),
        )
