"""Live scans on their way to templates: chain, causal track filter, coefficients, windows.

One object a drive, fed with blocks of scans in order; it holds the filter's state and as much of the past as a
window needs. The same functions serve batch registration and the vehicle.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import (
    ArrayGeometry,
    CoefficientBasis,
    apply_operator,
    centre_of,
    init_live_filter,
    run_live_filter,
    to_coefficients,
)
from lgprjax.registration.correlation import Template


class Track(NamedTuple):
    """Where the vehicle believes to be at each scan, and how it moved.

    Attributes:
        pose: prior pose of the array's centre: east_m, north_m, height_m above ground, yaw_rad (unwrapped),
            roll_rad.
        travel_m: signed distance travelled since the start of the drive, from odometry.
        speed_mps: signed.
        sigma_yaw_rad: of the prior.
    """

    pose: Float[np.ndarray, "scan 5"]
    travel_m: Float[np.ndarray, " scan"]
    speed_mps: Float[np.ndarray, " scan"]
    sigma_yaw_rad: Float[np.ndarray, " scan"]


class LiveScans(NamedTuple):
    """Scans ready to be matched, in order, with their numbers in the drive."""

    number: Int[np.ndarray, " scan"]
    coefficients: Float[np.ndarray, "scan channel coefficient"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    path_m: Float[np.ndarray, " scan"]
    dead_reckoned_m: Float[np.ndarray, "scan 2"]


class LiveChain:
    """Recorded traces of one drive to coefficients, block by block.

    Args:
        operator: of the drive's recording, with the map's settings.
        basis: of the map.
        track_filter_m: length of the track filter.
        channels: of the drive.
        history_m: how far back scans are kept for windows.
    """

    def __init__(
        self,
        operator: Float[Array, "recorded sample"],
        basis: CoefficientBasis,
        *,
        track_filter_m: float,
        channels: int,
        history_m: float,
    ) -> None:
        self._operator = operator
        self._basis = basis
        self._length_m = jnp.float32(track_filter_m)
        self._state = init_live_filter(channels, operator.shape[1])
        self._history_m = history_m
        self._held: LiveScans | None = None
        self._fed = 0

    def feed(
        self,
        traces: Float[np.ndarray, "scan channel recorded"],
        valid: Bool[np.ndarray, "scan channel"],
        track: Track,
        block: int,
    ) -> tuple[LiveScans, int]:
        """Process a block of scans.

        Args:
            traces: as recorded, zero level removed; finite where valid.
            valid: channels that hold data.
            track: of these scans.
            block: scans that a full block has; a shorter one is padded, so that one shape is compiled.

        Returns:
            the scans, preceded by those of the past that windows may need, and the index of the first new one.
        """
        scans = len(traces)
        pad = [(0, block - scans), (0, 0)]
        last = self._held
        before_m = track.travel_m[0] if last is None else last.track.travel_m[-1]
        moved = np.diff(track.travel_m, prepend=before_m)
        profile = apply_operator(jnp.asarray(np.pad(traces, [*pad, (0, 0)])), self._operator)
        ok = jnp.asarray(np.pad(valid, pad))
        self._state, filtered = run_live_filter(
            self._state,
            profile,
            ok,
            jnp.asarray(np.pad(moved, pad[0]), dtype=jnp.float32),
            self._length_m,
        )
        coefficients = np.asarray(to_coefficients(filtered, ok, self._basis))[:scans]
        step = moved[:, None] * np.stack([np.cos(track.pose[:, 3]), np.sin(track.pose[:, 3])], axis=1)
        path = np.cumsum(np.abs(moved)) + (0.0 if last is None else last.path_m[-1])
        reckoned = np.cumsum(step, axis=0) + (0.0 if last is None else last.dead_reckoned_m[-1])
        number = np.arange(self._fed, self._fed + scans)
        fresh = LiveScans(number, coefficients, valid, track, path, reckoned)
        self._fed += scans
        if last is None:
            joined, first = fresh, 0
        else:
            joined, first = _join(last, fresh), len(last.number)
        keep = joined.path_m >= joined.path_m[-1] - self._history_m
        # A vehicle that stands adds scans but no path: of one place the first scan is what windows take.
        keep[1:-1] &= joined.path_m[1:-1] > joined.path_m[:-2] + 1e-9
        keep[-1] = True
        self._held = _take(joined, np.flatnonzero(keep))
        return joined, first


def templates_of(
    scans: LiveScans,
    at: Int[np.ndarray, " batch"],
    array: ArrayGeometry,
    *,
    window_m: float,
    step_m: float,
) -> Template:
    """Templates whose last scans are ``at``: single scans, or windows of scans joined by odometry.

    A window holds a scan each ``step_m`` of the path back from its last one. Odometry and the INS heading
    place them against each other; a jump of GNSS cannot bend a window. Within a scan each channel stands
    where the vehicle had come when the switch matrix reached it.

    Args:
        scans: from ``LiveChain.feed``.
        at: indices into ``scans``.
        array: geometry of the drive.
        window_m: 0 for single scans.
        step_m: spacing within a window.
    """
    stations = 1 + round(window_m / step_m)
    channels = len(array.x_m)
    back = np.arange(stations) * step_m
    wanted = scans.path_m[at][:, None] - back[None, :]
    member = np.clip(np.searchsorted(scans.path_m, wanted - 1e-6), 0, len(scans.path_m) - 1)
    earlier = np.maximum(member - 1, 0)
    nearer = np.abs(scans.path_m[earlier] - wanted) < np.abs(scans.path_m[member] - wanted)
    member = np.where(nearer, earlier, member)
    member[:, 0] = at
    yaw = scans.track.pose[:, 3]
    apart = scans.dead_reckoned_m[member] - scans.dead_reckoned_m[at][:, None, :]
    cos, sin = np.cos(yaw[at])[:, None], np.sin(yaw[at])[:, None]
    forward = cos * apart[..., 0] + sin * apart[..., 1]
    left = cos * apart[..., 1] - sin * apart[..., 0]
    centre_x, centre_y = centre_of(array)
    turn = (yaw[member] - yaw[at][:, None])[..., None]
    carried = scans.track.speed_mps[member][..., None] * array.time_offset_s
    body_x, body_y = array.x_m - centre_x + carried, array.y_m - centre_y
    # The path is that of the rear axle; the array swings about it with the heading.
    swing_x = (np.cos(turn) - 1.0) * centre_x - np.sin(turn) * centre_y
    swing_y = np.sin(turn) * centre_x + (np.cos(turn) - 1.0) * centre_y
    x = forward[..., None] + swing_x + np.cos(turn) * body_x - np.sin(turn) * body_y
    y = left[..., None] + swing_y + np.sin(turn) * body_x + np.cos(turn) * body_y
    batch = len(at)
    last = np.zeros((batch, stations, channels), bool)
    last[:, 0] = True
    coefficients = scans.coefficients[member].reshape(batch, stations * channels, -1)
    return Template(
        coefficients=jnp.asarray(coefficients),
        offset_m=jnp.asarray(np.stack([x, y], axis=-1).reshape(batch, -1, 2), dtype=jnp.float32),
        valid=jnp.asarray(scans.valid[member].reshape(batch, -1)),
        last_scan=jnp.asarray(last.reshape(batch, -1)),
    )


def window_ends(scans: LiveScans, first: int, window_m: float, start_m: float) -> Int[np.ndarray, " end"]:
    """Scans from index ``first`` on that close a window: one each sixteenth of the window's length.

    ``start_m`` is the path length at the drive's first scan; the first window ends a full length after it.
    """
    every_m = window_m / 16.0
    path = scans.path_m[first:] - start_m
    before = scans.path_m[first - 1] - start_m if first else -1.0
    slot = np.floor((path + 1e-6) / every_m)
    earlier = np.concatenate([[np.floor((before + 1e-6) / every_m)], slot[:-1]])
    return first + np.flatnonzero((slot > earlier) & (path + 1e-6 >= window_m))


def _join(a: LiveScans, b: LiveScans) -> LiveScans:
    track = Track(*(np.concatenate(f) for f in zip(a.track, b.track, strict=True)))
    return LiveScans(
        np.concatenate([a.number, b.number]),
        np.concatenate([a.coefficients, b.coefficients]),
        np.concatenate([a.valid, b.valid]),
        track,
        np.concatenate([a.path_m, b.path_m]),
        np.concatenate([a.dead_reckoned_m, b.dead_reckoned_m]),
    )


def _take(scans: LiveScans, index: Int[np.ndarray, " kept"]) -> LiveScans:
    return LiveScans(
        scans.number[index],
        scans.coefficients[index],
        scans.valid[index],
        Track(*(field[index] for field in scans.track)),
        scans.path_m[index],
        scans.dead_reckoned_m[index],
    )
