"""A drive as map stations: profiles at equal steps along the track, surface return removed.

Scans come at equal times, the ground lies in metres. A station is the kernel-weighted mean of the scans
around its place; this is also the low-pass along the track without which a noisy map draws matches to the
middle between its traces (interpolation pull). Built as a stream: only the stretch under
the track filter is in memory.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.radar import ChainSettings, zero_phase_filter

_KERNEL = 0.5  # standard deviation of the station kernel, in steps
_REACH = 1.25  # the kernel is cut off here, in steps


class ScanBlock(NamedTuple):
    """Profiled scans of a drive, in order, with where they were taken.

    Attributes:
        profile: before the track filter.
        valid: channels that hold data.
        travel_m: distance travelled since the start of the drive; falls in reverse.
        pose: array centre (east_m, north_m, height_m above ground, yaw_rad, roll_rad), the yaw unwrapped.
        ground_up_m: local height of the ground under the array.
        antenna_m: antennas (east and north offset from the pose, height above ground).
        time_s: of the scan.
    """

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    travel_m: Float[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    time_s: Float[np.ndarray, " scan"]


class StationBlock(NamedTuple):
    """Stations of a baseline, in order; the fields of ``ScanBlock`` at equal steps, profile filtered."""

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    time_s: Float[np.ndarray, " scan"]


class Coherence(NamedTuple):
    """Running sums behind the depth gain.

    Attributes:
        power: of the traces.
        lagged, distant: product with the traces a short and a long lag farther on (see ``coherence_lags``).
        traces, lagged_pairs, distant_pairs: how many were summed.
    """

    power: Float[np.ndarray, " sample"]
    lagged: Float[np.ndarray, " sample"]
    distant: Float[np.ndarray, " sample"]
    traces: int
    lagged_pairs: int
    distant_pairs: int

    @staticmethod
    def empty(samples: int) -> "Coherence":
        """Nothing seen yet."""
        return Coherence(np.zeros(samples), np.zeros(samples), np.zeros(samples), 0, 0, 0)

    def add(self, block: StationBlock, lags: tuple[int, int]) -> "Coherence":
        """The sums after one more block."""
        lagged, lagged_pairs = _products(block, lags[0])
        distant, distant_pairs = _products(block, lags[1])
        return Coherence(
            self.power + np.sum(block.profile.astype(np.float64) ** 2, axis=(0, 1)),
            self.lagged + lagged,
            self.distant + distant,
            self.traces + int(block.valid.sum()),
            self.lagged_pairs + lagged_pairs,
            self.distant_pairs + distant_pairs,
        )

    @property
    def means(self) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
        """Means of power, lagged and distant product."""
        return (
            self.power / max(self.traces, 1),
            self.lagged / max(self.lagged_pairs, 1),
            self.distant / max(self.distant_pairs, 1),
        )


def coherence_lags(settings: ChainSettings, scan_spacing_m: float) -> tuple[int, int]:
    """Stations between traces whose agreement is called ground, and between those whose agreement is not.

    What agrees over an eighth of a wavelength is no noise; what still agrees over a whole one (what is left of
    the surface return, flat layers) says nothing about the place. Where stations are means of several scans,
    neighbours share noise, and the short lag is two at least.
    """
    shares_scans = scan_spacing_m < 0.9 * settings.step_m
    short = max(2 if shares_scans else 1, round(settings.wavelength_m / 8.0 / settings.step_m))
    return short, max(short + 1, round(settings.wavelength_m / settings.step_m))


def _products(block: StationBlock, lag: int) -> tuple[Float[np.ndarray, " sample"], int]:
    both = block.valid[lag:] & block.valid[:-lag]
    product = np.where(both[..., None], block.profile[lag:] * block.profile[:-lag], 0.0)
    return np.asarray(np.sum(product, axis=(0, 1), dtype=np.float64)), int(both.sum())


def stations_of_drive(
    blocks: Iterable[ScanBlock], settings: ChainSettings, scan_spacing_m: float
) -> Iterator[StationBlock]:
    """Scans of one drive to its stations, streaming.

    Standing adds nothing and reverse is left out: a station takes scans only from the first time the vehicle
    came by. A station whose neighbourhood no scan came near is skipped.

    Args:
        blocks: the drive's scans in order.
        settings: the chain; names the step and the track filter.
        scan_spacing_m: typical distance between scans; where it is no finer than the step, a station is its
            nearest scan.

    Yields:
        blocks of filtered stations, each station once.
    """
    filter_stations = max(3, round(settings.track_filter_m / settings.step_m))
    halo = filter_stations // 2
    smooth = scan_spacing_m < 0.9 * settings.step_m
    pending: StationBlock | None = None
    before = 0
    for block in _uniform(blocks, settings.step_m, smooth):
        pending = block if pending is None else _concatenate(pending, block)
        ready = len(pending.pose) - halo
        if ready - before >= 256:
            yield _filtered(pending, before, ready, filter_stations)
            cut = max(ready - halo, 0)
            pending, before = _slice(pending, cut, len(pending.pose)), ready - cut
    if pending is not None and len(pending.pose) > before:
        yield _filtered(pending, before, len(pending.pose), filter_stations)


def _filtered(block: StationBlock, first: int, last: int, stations: int) -> StationBlock:
    filtered = block._replace(profile=zero_phase_filter(block.profile, block.valid, stations))
    return _slice(filtered, first, last)


def _uniform(blocks: Iterable[ScanBlock], step_m: float, smooth: bool) -> Iterator[StationBlock]:
    """Unfiltered stations; holds back the scans that later stations still need."""
    held: ScanBlock | None = None
    farthest, next_station = -np.inf, 0
    origin: float | None = None
    for block in blocks:
        if origin is None:
            origin = float(block.travel_m[0])
        block = block._replace(travel_m=block.travel_m - origin)
        reach = np.maximum.accumulate(np.maximum(block.travel_m, farthest))
        fresh = np.diff(reach, prepend=farthest if np.isfinite(farthest) else -1.0) > 0.0
        farthest = float(reach[-1])
        block = ScanBlock(*(field[fresh] for field in block))
        held = block if held is None else ScanBlock(*(np.concatenate(f) for f in zip(held, block, strict=True)))
        complete = int(np.floor(farthest / step_m - _REACH)) + 1
        if complete > next_station:
            yield _stations(held, np.arange(next_station, complete) * step_m, step_m, smooth)
            next_station = complete
            keep = held.travel_m >= (next_station - _REACH) * step_m
            held = ScanBlock(*(field[keep] for field in held))
    if held is not None and len(held.travel_m):
        rest = np.arange(next_station, int(np.floor(farthest / step_m + 0.5)) + 1) * step_m
        yield _stations(held, rest, step_m, smooth)


def _stations(scans: ScanBlock, at_m: Float[np.ndarray, " scan"], step_m: float, smooth: bool) -> StationBlock:
    apart = scans.travel_m[None, :] - at_m[:, None]
    if smooth:
        weight = np.where(np.abs(apart) <= _REACH * step_m, np.exp(-0.5 * (apart / (_KERNEL * step_m)) ** 2), 0.0)
    else:
        nearest = np.abs(apart).argmin(axis=1)
        near = np.abs(apart[np.arange(len(at_m)), nearest]) <= 0.75 * step_m
        weight = np.zeros_like(apart)
        weight[np.arange(len(at_m)), nearest] = near
    seen = weight.sum(axis=1) > 0.05
    weight = weight[seen]
    of_channel = weight[:, :, None] * scans.valid[None]
    total = of_channel.sum(axis=1)
    share = of_channel / np.maximum(total, 1e-9)[:, None, :]
    weight = weight / weight.sum(axis=1, keepdims=True)
    profile = np.einsum("kns,nst->kst", share, scans.profile, optimize=True)
    return StationBlock(
        profile=profile.astype(np.float32),
        valid=total > 0.05,
        pose=weight @ scans.pose,
        ground_up_m=weight @ scans.ground_up_m,
        antenna_m=np.einsum("kn,ncd->kcd", weight, scans.antenna_m),
        time_s=weight @ scans.time_s,
    )


def _concatenate(a: StationBlock, b: StationBlock) -> StationBlock:
    return StationBlock(*(np.concatenate(fields) for fields in zip(a, b, strict=True)))


def _slice(block: StationBlock, first: int, last: int) -> StationBlock:
    return StationBlock(*(field[first:last] for field in block))
