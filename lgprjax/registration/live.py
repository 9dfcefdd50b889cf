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
    CoefficientBasis,
    apply_operator,
    init_live_filter,
    run_live_filter,
    to_coefficients,
)

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
        sigma_m: of the prior position, each axis; NaN where the log does not state it.
        leg: rising number of the stretch over which travel is known.
    """

    pose: Float[np.ndarray, "scan 5"]
    travel_m: Float[np.ndarray, " scan"]
    speed_mps: Float[np.ndarray, " scan"]
    sigma_yaw_rad: Float[np.ndarray, " scan"]
    sigma_m: Float[np.ndarray, " scan"]
    leg: Int[np.ndarray, " scan"]


class LiveScans(NamedTuple):
    """Scans of a block ready to be searched, in order.

    Attributes:
        number: in the drive.
        filtered: traces as recorded, track filter applied; ``LiveChain.coefficients`` makes templates of them.
        valid: channels that hold data.
        track: of the scans.
        path_m: travel, never falling.
        dead_reckoned_m: of the rear axle, by odometry and heading alone.
    """

    number: Int[np.ndarray, " scan"]
    filtered: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    path_m: Float[np.ndarray, " scan"]
    dead_reckoned_m: Float[np.ndarray, "scan 2"]


class LiveChain:
    """Recorded traces of one drive to coefficients, block by block.

    The track filter is linear and works along the track, what makes profiles of traces is linear and works along the
    trace: the filter comes first, so that a scan can be asked for at any time scale later.

    Args:
        operators: of the drive's recording at a time scale, with the map's settings.
        basis: of the map.
        track_filter_m: length of the track filter.
        channels: of the drive.
        recorded: numbers of a trace.
    """

    def __init__(
        self, operators: Operators, basis: CoefficientBasis, *, track_filter_m: float, channels: int, recorded: int
    ) -> None:
        self._operators = operators
        self._basis = basis
        self._length_m = jnp.float32(track_filter_m)
        self._state = init_live_filter(channels, recorded)
        self._fed = 0
        self._path_m = 0.0
        self._reckoned_m = np.zeros(2)
        self._travel_m: float | None = None

    def feed(
        self,
        traces: Float[np.ndarray, "scan channel recorded"],
        valid: Bool[np.ndarray, "scan channel"],
        track: Track,
        block: int,
    ) -> LiveScans:
        """Filter a block of scans.

        Args:
            traces: as recorded, zero level removed; finite where valid.
            valid: channels that hold data.
            track: of these scans.
            block: scans that a full block has; a shorter one is padded, so that one shape is compiled.
        """
        scans = len(traces)
        pad = [(0, block - scans), (0, 0)]
        before_m = track.travel_m[0] if self._travel_m is None else self._travel_m
        moved = np.diff(track.travel_m, prepend=before_m)
        self._state, filtered = run_live_filter(
            self._state,
            jnp.asarray(np.pad(traces, [*pad, (0, 0)]), dtype=jnp.float32),
            jnp.asarray(np.pad(valid, pad)),
            jnp.asarray(np.pad(moved, pad[0]), dtype=jnp.float32),
            self._length_m,
        )
        step = moved[:, None] * np.stack([np.cos(track.pose[:, 3]), np.sin(track.pose[:, 3])], axis=1)
        path_m = self._path_m + np.cumsum(np.abs(moved))
        reckoned_m = self._reckoned_m + np.cumsum(step, axis=0)
        number = np.arange(self._fed, self._fed + scans)
        self._fed += scans
        self._travel_m, self._path_m, self._reckoned_m = float(track.travel_m[-1]), float(path_m[-1]), reckoned_m[-1]
        return LiveScans(number, np.asarray(filtered)[:scans], valid, track, path_m, reckoned_m)

    def coefficients(
        self,
        filtered: Float[np.ndarray, "scan channel recorded"],
        valid: Bool[np.ndarray, "scan channel"],
        time_scale: float,
    ) -> Float[np.ndarray, "scan channel coefficient"]:
        """Coefficients of filtered scans at a time scale (how much longer the wave's way in the ground takes today)."""
        rows = max(16, 1 << max(0, len(filtered) - 1).bit_length())
        pad = [(0, rows - len(filtered)), (0, 0)]
        profile = apply_operator(jnp.asarray(np.pad(filtered, [*pad, (0, 0)])), self._operators(time_scale))
        return np.asarray(to_coefficients(profile, jnp.asarray(np.pad(valid, pad)), self._basis))[: len(filtered)]
