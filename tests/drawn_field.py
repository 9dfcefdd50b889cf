"""A small field that was worked, drawn by hand: its plan, and runs over it as the recorder would have left them."""

import json
import struct
from pathlib import Path
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np
from jaxtyping import Float

from formats.run_log_sample import RUN, head_bytes, own_bytes, record_bytes
from lgprjax.frames import LocalFrame
from lgprjax.worked.plans import PlanFile, PlanOptions, make_cover_plan, open_cover_plan, save_cover_plan

VEHICLE = """
schema = "lgprjax.vehicle"
schema_version = "1.3"
name = "small flail"
steering_kind = "skid_steer"
[skid_steer]
track_m = 1.0
smallest_radius_m = 1.0
largest_wheel_mps = 1.0
wheel_rate_mps2 = 1.0
[tool]
width_m = 1.0
length_m = 0.4
ahead_m = 0.8
depth_m = 0.15
depth_tolerance_m = 0.03
"""
FIELD_M = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0]])
MONO_NS, UTC_NS = 10**12, 1_800_000_000_000_000_000
COVER = np.dtype(
    [
        ("x_m", "<f8"),
        ("y_m", "<f8"),
        ("yaw_rad", "<f8"),
        ("covariance", "<f4", (3, 3)),
        ("speed_mps", "<f4"),
        ("left_mps", "<f4"),
        ("right_mps", "<f4"),
        ("tool", "<u1"),
        ("depth_m", "<f4"),
        ("mode", "<u1"),
        ("line", "<i4"),
        ("stop", "<u2"),
        ("gnss_quality", "<u1"),
    ]
)
"""As data_schema/run_log.toml has it, written down once more."""
_HEADER, _EVENT, _COVER, _CONTROL = 1, 8, 13, 10
_SPEED_MPS = 0.4


class Drive(NamedTuple):
    """Straight lines to and fro along the field's first side.

    Attributes:
        lines: which of the plan, from 0, and how far from the first side each is.
        sigma_m: of x and y; the yaw's is a tenth of it a metre.
        tool: its bits, all the way.
        stop_s: seconds of a stop in the middle of the first line, by the operator.
    """

    lines: tuple[tuple[int, float], ...]
    sigma_m: float = 0.01
    tool: int = 15
    stop_s: float = 0.0


def write_field(
    folder: Path, corners_m: Float[np.ndarray, "_ 2"] = FIELD_M, height_m: float = 0.0
) -> tuple[Path, Path]:
    """Files of a field and of the vehicle."""
    frame = LocalFrame(40.0, -100.0, height_m)
    latitude, longitude, _ = frame.to_geodetic(corners_m[:, 0], corners_m[:, 1], np.zeros(len(corners_m)))
    ring = [[float(x), float(y), height_m] for x, y in zip(longitude, latitude, strict=True)]
    polygon = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    (folder / "f.geojson").write_text(json.dumps(polygon), encoding="utf-8")
    (folder / "v.vehicle.toml").write_text(VEHICLE, encoding="utf-8")
    return folder / "f.geojson", folder / "v.vehicle.toml"


def drawn_plan(folder: Path) -> PlanFile:
    """The plan of the field's five lines."""
    made = make_cover_plan(*write_field(folder), PlanOptions(0.0, "boustrophedon"))
    assert made is not None
    save_cover_plan(folder / "f.cover.geojson", made)
    return open_cover_plan(folder / "f.cover.geojson")


def cover_rows(drive: Drive) -> tuple[np.ndarray, Float[np.ndarray, " row"]]:
    """Moments of a drive and their times, s: the tool's centre goes from one side of the field to the other."""
    length_m, ahead_m, parts = 8.0, 0.8, []
    for number, (line, north_m) in enumerate(drive.lines):
        forward = number % 2 == 0
        # The whole tool leaves the field at both ends.
        along = np.arange(-0.5, length_m + 0.5, 0.1 * _SPEED_MPS)
        rows = np.zeros(len(along), COVER)
        rows["x_m"] = along - ahead_m if forward else length_m - along + ahead_m
        rows["y_m"], rows["yaw_rad"] = north_m, 0.0 if forward else np.pi
        rows["line"], rows["tool"], rows["speed_mps"], rows["depth_m"] = line, drive.tool, _SPEED_MPS, 0.15
        rows["left_mps"] = rows["right_mps"] = _SPEED_MPS
        if number == 0 and drive.stop_s:
            stands = np.repeat(rows[len(rows) // 2 : len(rows) // 2 + 1], round(10 * drive.stop_s))
            stands["stop"], stands["tool"], stands["speed_mps"] = 1, 0, 0.0
            rows = np.concatenate([rows[: len(rows) // 2], stands, rows[len(rows) // 2 :]])
        turn = np.repeat(rows[-1:], 20)
        turn["tool"], turn["line"] = 0, -1
        parts += [rows, turn]
    rows = np.concatenate(parts)
    rows["covariance"] = np.diag([drive.sigma_m**2, drive.sigma_m**2, (0.1 * drive.sigma_m) ** 2])
    rows["mode"], rows["gnss_quality"] = 5, 3
    return rows, 0.1 * np.arange(len(rows))


def write_cover_run(
    folder: Path,
    rows: np.ndarray,
    time_s: Float[np.ndarray, " row"],
    *,
    begin_s: float = 0.0,
    plan_sha256: str | None = None,
    machine: str | None = None,
    header: dict[str, Any] | None = None,
    anchor: list[float] | None = None,
) -> None:
    """A run with these moments and two events, its UUID told by its beginning; ``header`` and ``anchor`` of a run
    without a plan."""
    folder.mkdir(parents=True)
    run = UUID(int=RUN.int ^ int(begin_s))
    begin_ns = MONO_NS + int(1e9 * begin_s)

    def record(number: int, kind: int, mono_ns: int, payload: bytes) -> bytes:
        head = struct.pack("<BBHIQ", kind, _CONTROL, 0, 7, mono_ns)
        return record_bytes(number, head + payload, run=run)

    head = head_bytes(0, 0, utc_ns=UTC_NS, mono_ns=MONO_NS, run=run)
    parts = [head, own_bytes(0, run=run, dropped={"control_log": 0})]
    told: dict[int, dict[str, Any]] = {
        0: {"event": "speed_engaged", "mode": "speed"},
        len(rows) - 1: {"event": "route_done"},
    }
    if anchor is not None:
        told[0] = {"anchor": anchor}
    if header is None:
        header = {"version": "0", "plan_sha256": plan_sha256} | ({} if machine is None else {"machine": machine})
    parts.append(record(1, _HEADER, begin_ns, json.dumps(header).encode()))
    number = 2
    for row, at_s in enumerate(time_s):
        mono_ns = begin_ns + round(1e9 * float(at_s))
        parts.append(record(number, _COVER, mono_ns, rows[row].tobytes()))
        number += 1
        if row in told:
            parts.append(record(number, _EVENT, mono_ns, json.dumps(told[row]).encode()))
            number += 1
    parts.append(own_bytes(number, run=run, end="ended"))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))
