"""Live scans prepared for matching: background removal, coefficients, windows.

One object per drive, fed with blocks of scans in order; it holds the filter's state and as much history as a window
needs. Batch registration and the vehicle share these functions.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.frames import body_to_local
from lgprjax.radar import (
    ArrayGeometry,
    CoefficientBasis,
    apply_operator,
    centre_of,
    init_live_filter,
    run_live_filter,
    to_coefficients,
)
from lgprjax.registration.judge import MIN_OVERLAP, RegisterOptions, ladder_of
from lgprjax.registration.refine import FEW_CHANNELS
from lgprjax.registration.score import Template
from lgprjax.registration.template_bank import PreparedGround

Operators = Callable[[float], Float[Array, "recorded sample"]]
"""Time scale to the matrix from recorded numbers of a trace to profile samples; one shape for all scales."""


class Track(NamedTuple):
    """Prior poses and motion of the vehicle at each scan.

    Attributes:
        pose: prior pose of the array's centre: east_m, north_m, height_m above ground, yaw_rad (unwrapped),
            roll_rad.
        travel_m: signed distance travelled since the start of the drive, from odometry.
        speed_mps: signed speed.
        sigma_yaw_rad: standard deviation of the prior's yaw.
        sigma_m: standard deviation of the prior position per axis; NaN if the log states none.
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
        number: number of each scan in the drive.
        filtered: recorded traces with the background removed; ``LiveChain.coefficients`` converts them to templates.
        valid: mask of channels with data.
        track: prior poses and motion of the scans.
        path_m: travel, never falling; the negative travel of the drive if scans come in the opposite order.
        dead_reckoned_m: position of the rear axle by odometry and heading alone.
        settled: whether the drive's background is known; before, ``filtered`` includes the background.
        background: background of each channel, in the block in which it becomes known: to be subtracted from the scans
            of earlier blocks.
        settled_m: travel from which the background is known.
    """

    number: Int[np.ndarray, " scan"]
    filtered: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    path_m: Float[np.ndarray, " scan"]
    dead_reckoned_m: Float[np.ndarray, "scan 2"]
    settled: bool = True
    background: Float[np.ndarray, "channel recorded"] | None = None
    settled_m: float = 0.0


# Of the filter's length: travel after which a drive's background is known. A mean that has just begun is that of the
# ground just behind, and subtracting it moves what remains ahead, at the very start by half a wavelength. The first
# scans therefore wait, and have the mean over all of them subtracted: no time where a drive comes in long blocks.
SETTLED = 0.5


class LiveChain:
    """Converts recorded traces of one drive to coefficients, block by block.

    Background removal is linear along the track, the conversion of traces to profiles is linear along the trace: the
    filter comes first, so that a scan can be converted at any time scale later.

    The first scans, up to half the filter's length, share one background; see ``LiveScans.settled``.

    Args:
        operators: operators of the drive's recording at a time scale, with the map's settings.
        basis: coefficient basis of the map.
        track_filter_m: length of the background removal.
        zero_slip_m: zero-slip point of the vehicle, see ``ArrayGeometry``.
        channels: number of channels of the drive.
        recorded: recorded numbers per trace.
    """

    def __init__(
        self,
        operators: Operators,
        basis: CoefficientBasis,
        *,
        track_filter_m: float,
        channels: int,
        recorded: int,
        zero_slip_m: float = 0.0,
    ) -> None:
        self._operators = operators
        self._basis = basis
        self._length_m = jnp.float32(track_filter_m)
        self._settled_m, self._settled = SETTLED * track_filter_m, False
        self._state = init_live_filter(channels, recorded)
        self._fed = 0
        self._zero_slip_m, self._path_m = zero_slip_m, 0.0
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
            traces: recorded traces, zero level removed; finite where valid.
            valid: mask of channels with data.
            track: prior poses and motion of these scans.
            block: number of scans of a full block; a shorter one is padded, so that one shape is compiled.
        """
        scans = len(traces)
        before_m = track.travel_m[0] if self._travel_m is None else self._travel_m
        moved = np.diff(track.travel_m, prepend=before_m)
        path_m = _summed(self._path_m, np.abs(moved))
        background = None
        if self._settled:
            filtered = self._filter(traces, valid, moved, block)
        else:
            at = int(np.searchsorted(path_m, self._settled_m))
            first = (np.arange(scans) <= at)[:, None]
            self._filter(traces, valid & first, moved, block)
            filtered = np.where(valid[..., None], traces, 0.0).astype(np.float32)
            if at < scans:
                background, self._settled = np.asarray(self._state.mean), True
                filtered -= np.where(valid[..., None], background, 0.0)
                filtered = np.where(first[..., None], filtered, self._filter(traces, valid & ~first, moved, block))
        facing = np.stack([np.cos(track.pose[:, 3]), np.sin(track.pose[:, 3])], axis=1)
        straight_m = _summed(self._reckoned_m, moved[:, None] * facing)
        reckoned_m = straight_m - self._zero_slip_m * facing
        number = np.arange(self._fed, self._fed + scans)
        self._fed += scans
        self._travel_m, self._path_m, self._reckoned_m = float(track.travel_m[-1]), float(path_m[-1]), straight_m[-1]
        return LiveScans(
            number=number,
            filtered=filtered,
            valid=valid,
            track=track,
            path_m=path_m,
            dead_reckoned_m=reckoned_m,
            settled=self._settled,
            background=background,
            settled_m=self._settled_m,
        )

    def _filter(
        self,
        traces: Float[np.ndarray, "scan channel recorded"],
        valid: Bool[np.ndarray, "scan channel"],
        moved_m: Float[np.ndarray, " scan"],
        block: int,
    ) -> Float[np.ndarray, "scan channel recorded"]:
        """Scans less the running mean, which takes in the valid ones."""
        pad = [(0, block - len(traces)), (0, 0)]
        self._state, filtered = run_live_filter(
            self._state,
            jnp.asarray(np.pad(traces, [*pad, (0, 0)]), dtype=jnp.float32),
            jnp.asarray(np.pad(valid, pad)),
            jnp.asarray(np.pad(moved_m, pad[0]), dtype=jnp.float32),
            self._length_m,
        )
        return np.asarray(filtered)[: len(traces)]

    def coefficients(
        self,
        filtered: Float[np.ndarray, "scan channel recorded"],
        valid: Bool[np.ndarray, "scan channel"],
        time_scale: float,
    ) -> Float[np.ndarray, "scan channel coefficient"]:
        """Coefficients of filtered scans at a time scale (travel time in the ground relative to the map)."""
        rows = max(16, 1 << max(0, len(filtered) - 1).bit_length())
        pad = [(0, rows - len(filtered)), (0, 0)]
        profile = apply_operator(jnp.asarray(np.pad(filtered, [*pad, (0, 0)])), self._operators(time_scale))
        return np.asarray(to_coefficients(profile, jnp.asarray(np.pad(valid, pad)), self._basis))[: len(filtered)]


def _summed(
    before: float | Float[np.ndarray, "..."], more: Float[np.ndarray, "scan ..."]
) -> Float[np.ndarray, "scan ..."]:
    """Running sums from ``before`` on: one after the other, so that they are the same however scans come in blocks."""
    return np.asarray(np.cumsum(np.concatenate([np.reshape(before, (1, *more.shape[1:])), more]), axis=0)[1:])


# Scans that represent their stretch of travel (stops), and the templates made from them.

_SPACING = 0.3  # of the wavelength, from stop to stop
_LEAST_WIDTH = 1.0  # of the wavelength: least width of an array over mapped ground
_LEAST_SHARE = 0.3  # of an array's width, however wide
_FINE_TRACES = 192  # of a window that the finish takes


class Stops(NamedTuple):
    """Scans that represent their stretch of travel, in order, history first.

    Attributes:
        number: number of the scan in its drive.
        filtered: recorded traces with the background removed.
        coefficients, valid: coefficients and validity of each trace, at the time scale of that moment.
        pose, speed_mps, sigma_yaw_rad: pose, speed and standard deviation of yaw of the prior.
        reckoned_m: position of the array's centre by odometry and heading alone.
        path_m: travel; the negative travel of the drive if scans come in the opposite order.
        leg: number of the stretch over which travel is known.
    """

    number: Int[np.ndarray, " stop"]
    filtered: Float[np.ndarray, "stop channel recorded"]
    coefficients: Float[np.ndarray, "stop channel coefficient"]
    valid: Bool[np.ndarray, "stop channel"]
    pose: Float[np.ndarray, "stop 5"]
    speed_mps: Float[np.ndarray, " stop"]
    sigma_yaw_rad: Float[np.ndarray, " stop"]
    reckoned_m: Float[np.ndarray, "stop 2"]
    path_m: Float[np.ndarray, " stop"]
    leg: Int[np.ndarray, " stop"]


@dataclass(frozen=True)
class SearchSizes:
    """Sizes of a search on a map.

    Attributes:
        spacing_m: travel between stops.
        lattice_m: step of the lattice of prior errors, forward and left.
        windows_m: window lengths tried.
        history: number of stops covered by the longest window.
        members: number of a window's scans used for refinement.
        min_overlap: least share of a window's traces over mapped ground.
    """

    spacing_m: float
    lattice_m: Float[np.ndarray, "2"]
    windows_m: tuple[float, ...]
    history: int
    members: int
    min_overlap: float

    @staticmethod
    def of(prepared: PreparedGround, options: RegisterOptions) -> "SearchSizes":
        """Plan of a search."""
        wavelength_m = prepared.ground.description.settings.wavelength_m
        windows_m = ladder_of(wavelength_m) if options.window_m is None else (options.window_m,)
        longest_m = max(windows_m)
        spacing_m = _SPACING * wavelength_m if longest_m > 0.0 else 0.0
        history = int(np.ceil(longest_m / spacing_m)) + 2 if longest_m > 0.0 else 0
        channels = len(prepared.array.x_m)
        members = 1 if longest_m <= 0.0 else int(np.clip(_FINE_TRACES // channels, 8, 64))
        own = options.own_thresholds
        least = least_overlap(prepared.array, wavelength_m) if own is None else own.overlap
        return SearchSizes(spacing_m, prepared.step_m, windows_m, history, members, least)

    def points(self, half_m: float) -> tuple[int, int]:
        """Points, forward and left, of a lattice with this half side."""
        forward, left = (2 * int(np.ceil(half_m / step_m)) + 1 for step_m in self.lattice_m)
        return forward, left


def least_overlap(array: ArrayGeometry, wavelength_m: float) -> float:
    """Least share of an array's traces over mapped ground.

    Traces off the map neither add to a match nor take from it: a score is as rare by chance with half of its traces as
    with all. The traces on the map must span more than the ground's correlation length, or the map's outermost line
    would match ground next to it.
    """
    if len(array.x_m) <= FEW_CHANNELS:
        return MIN_OVERLAP
    return float(np.clip(_LEAST_WIDTH * wavelength_m / max(np.ptp(array.y_m), 1e-6), _LEAST_SHARE, MIN_OVERLAP))


def stops_of(
    scans: LiveScans, chosen: Int[np.ndarray, " stop"], array: ArrayGeometry, basis: CoefficientBasis
) -> Stops:
    """Stops of these scans, without coefficients yet."""
    track, valid = scans.track, scans.valid[chosen]
    yaw = track.pose[chosen, 3]
    lever = np.stack(body_to_local(np.zeros(len(yaw)), np.zeros(len(yaw)), yaw, *centre_of(array)), axis=1)
    return Stops(
        number=scans.number[chosen],
        filtered=scans.filtered[chosen],
        coefficients=np.zeros((*valid.shape, 2 * len(basis.angular_frequency_rad_per_ns)), np.float32),
        valid=valid,
        pose=track.pose[chosen],
        speed_mps=track.speed_mps[chosen],
        sigma_yaw_rad=track.sigma_yaw_rad[chosen],
        reckoned_m=scans.dead_reckoned_m[chosen] + lever,
        path_m=scans.path_m[chosen],
        leg=track.leg[chosen],
    )


def rotation(angle_rad: float | Float[np.ndarray, "*angle"]) -> Float[np.ndarray, "2 2 *angle"]:
    """Matrices that turn east and north counterclockwise."""
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def turned(stops: Stops, more: Float[np.ndarray, "3"], at: int) -> Stops:
    """Stops with changed height, heading and roll, and dead reckoning turned about one of them."""
    pose, about_m = stops.pose.copy(), stops.reckoned_m[at]
    pose[:, 2:5] += more
    return stops._replace(pose=pose, reckoned_m=(stops.reckoned_m - about_m) @ rotation(more[1]).T + about_m)


def templates_of(
    stops: Stops,
    array: ArrayGeometry,
    last: Int[np.ndarray, " end"],
    member: Int[np.ndarray, "end member"],
    fresh: Bool[np.ndarray, "end member"],
) -> Template:
    """Traces of the members relative to the last scan's centre, in its body frame: odometry and heading place the
    scans, and within a scan each channel is at the vehicle's position when the switch matrix reached it.

    Args:
        stops: scans of the drive.
        array: array of the drive.
        last: last scan of each template.
        member: scans of each template, the last one first.
        fresh: mask of members to use.
    """
    centre = centre_of(array)
    yaw = stops.pose[:, 3]
    apart = stops.reckoned_m[member] - stops.reckoned_m[last][:, None]
    body_x = array.x_m - centre[0] + stops.speed_mps[member][..., None] * array.time_offset_s
    body_y = np.broadcast_to(array.y_m - centre[1], body_x.shape)
    own = yaw[member][..., None]
    east = apart[..., 0, None] + np.cos(own) * body_x - np.sin(own) * body_y
    north = apart[..., 1, None] + np.sin(own) * body_x + np.cos(own) * body_y
    cos, sin = np.cos(yaw[last])[:, None, None], np.sin(yaw[last])[:, None, None]
    offset = np.stack([cos * east + sin * north, cos * north - sin * east], axis=-1)
    count, members, channels = east.shape
    valid = stops.valid[member] & fresh[..., None]
    coefficients = np.where(valid[..., None], stops.coefficients[member], 0.0)
    scan = np.broadcast_to(np.arange(members, dtype=np.int32)[None, :, None], (count, members, channels))
    return Template(
        jnp.asarray(coefficients.reshape(count, members * channels, -1), dtype=jnp.float32),
        jnp.asarray(offset.reshape(count, -1, 2), dtype=jnp.float32),
        jnp.asarray(valid.reshape(count, -1)),
        jnp.asarray(scan.reshape(count, -1)),
    )
