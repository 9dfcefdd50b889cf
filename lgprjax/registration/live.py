"""Live scans on their way to templates: chain, causal track filter, coefficients, windows.

One object a drive, fed with blocks of scans in order; it holds the filter's state and as much of the past as a
window needs. The same functions serve batch registration and the vehicle.
"""

from collections.abc import Callable
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

Operators = Callable[[float], Float[Array, "recorded sample"]]
"""Time scale to the matrix from recorded numbers of a trace to profile samples; one shape for all scales."""


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
        operators: of the drive's recording at a time scale, with the map's settings.
        basis: of the map.
        track_filter_m: length of the track filter.
        channels: of the drive.
        history_m: how far back scans are kept for windows.
    """

    def __init__(
        self,
        operators: Operators,
        basis: CoefficientBasis,
        *,
        track_filter_m: float,
        channels: int,
        history_m: float,
    ) -> None:
        self._operators = operators
        self._basis = basis
        self._length_m = jnp.float32(track_filter_m)
        self._state = init_live_filter(channels, len(basis.gain))
        self._history_m = history_m
        self._held: LiveScans | None = None
        self._fed = 0

    def feed(
        self,
        traces: Float[np.ndarray, "scan channel recorded"],
        valid: Bool[np.ndarray, "scan channel"],
        track: Track,
        block: int,
        time_scale: Float[np.ndarray, " scan"] | None = None,
    ) -> tuple[LiveScans, int]:
        """Process a block of scans.

        Args:
            traces: as recorded, zero level removed; finite where valid.
            valid: channels that hold data.
            track: of these scans.
            block: scans that a full block has; a shorter one is padded, so that one shape is compiled.
            time_scale: of each scan, few different ones; 1 where there is none.

        Returns:
            the scans, preceded by those of the past that windows may need, and the index of the first new one.
        """
        scans = len(traces)
        pad = [(0, block - scans), (0, 0)]
        last = self._held
        before_m = track.travel_m[0] if last is None else last.track.travel_m[-1]
        moved = np.diff(track.travel_m, prepend=before_m)
        profile = self._profile(jnp.asarray(np.pad(traces, [*pad, (0, 0)])), time_scale)
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

    def _profile(
        self, traces: Float[Array, "block channel recorded"], time_scale: Float[np.ndarray, " scan"] | None
    ) -> Float[Array, "block channel sample"]:
        of_scan = np.ones(1) if time_scale is None else time_scale
        of_scan = np.pad(of_scan, (0, len(traces) - len(of_scan)), mode="edge")
        scales = np.unique(of_scan)
        profile: Float[Array, "block channel sample"] = apply_operator(traces, self._operators(float(scales[0])))
        for scale in scales[1:]:
            own = jnp.asarray(of_scan == scale)[:, None, None]
            profile = jnp.where(own, apply_operator(traces, self._operators(float(scale))), profile)
        return profile


def templates_of(
    scans: LiveScans,
    at: Int[np.ndarray, " batch"],
    array: ArrayGeometry,
    *,
    window_m: float,
    step_m: float,
) -> Template:
    """One template for each scan index in ``at``: that scan, or the window that ends with it.

    Args:
        scans: from ``LiveChain.feed``.
        at: indices into ``scans``.
        array: geometry of the drive.
        window_m: 0 for single scans.
        step_m: spacing within a window.
    """
    member = window_members(scans, at, window_m=window_m, step_m=step_m)
    batch, stations = member.shape
    channels = len(array.x_m)
    last = np.zeros((batch, stations, channels), bool)
    last[:, 0] = True
    coefficients = scans.coefficients[member].reshape(batch, stations * channels, -1)
    return Template(
        coefficients=jnp.asarray(coefficients),
        offset_m=jnp.asarray(trace_offsets(scans, at, member, array), dtype=jnp.float32),
        valid=jnp.asarray(scans.valid[member].reshape(batch, -1)),
        last_scan=jnp.asarray(last.reshape(batch, -1)),
    )


def window_members(
    scans: LiveScans, at: Int[np.ndarray, " batch"], *, window_m: float, step_m: float
) -> Int[np.ndarray, "batch member"]:
    """Indices of the scans of each window: its last one, then those at every whole ``step_m`` of the path behind it.

    The steps are the path's, not the window's, so that windows one scan apart share their scans; the farthest lies up
    to half a step more than the window behind.
    """
    count = int(window_m / step_m + 1e-6)
    path_m = scans.path_m
    newest = np.ceil(path_m[at] / step_m - 0.5) - 1.0
    wanted = (newest[:, None] - np.arange(count)) * step_m
    member = np.clip(np.searchsorted(path_m, wanted - 1e-6), 0, len(path_m) - 1)
    earlier = np.maximum(member - 1, 0)
    nearer = np.abs(path_m[earlier] - wanted) < np.abs(path_m[member] - wanted)
    member = np.where(nearer, earlier, member)
    return np.concatenate([at[:, None], member], axis=1)


def trace_offsets(
    scans: LiveScans, at: Int[np.ndarray, " batch"], member: Int[np.ndarray, "batch member"], array: ArrayGeometry
) -> Float[np.ndarray, "batch trace 2"]:
    """Where the members' traces stand relative to the array's centre at the last scan, in its body frame.

    Odometry and INS heading place the scans; within a scan each channel stands where the vehicle had come when the
    switch matrix reached it.
    """
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
    return np.stack([x, y], axis=-1).reshape(len(at), -1, 2)


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
