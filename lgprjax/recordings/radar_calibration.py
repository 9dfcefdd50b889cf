"""Calibration of a stepped-frequency radar from sweeps of a stationary array: look-up and channel response.

Sweeps are divided by their calibration sweep and averaged over groups of consecutive scans; the median over the groups
is the calibration. Disturbances of fewer than half of the groups do not change it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import reduce
from itertools import islice, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, SweepLayout, SweepRecording, complex_rows, read_run
from lgprjax.formats.mcap_import import array_message, gather, radar_topic, scans_of
from lgprjax.formats.mcap_recording import SWEEPS, layout_of_form
from lgprjax.formats.rosbag_recording import open_recording
from lgprjax.radar import estimate_channel_response, find_dead_channels
from lgprjax.recordings.recover import layout_of
from lgprjax.recordings.run_signals import scan_frames, signals_of_run
from lgprjax.recordings.verdicts import HealthFigure, figure
from lgprjax.wire import decode

_LEAST_SCANS = 64
"""Least number of scans, as for the detection of dead channels."""
_GROUPS = 16
_AT_LIMIT, _PLACES = 0.05, 3
"""Parts of sweeps are saturated if this share of the scans is at the largest value, at three frequencies or more."""
_AGREES = 0.98
"""A plate's echo that agrees less with the other channels is not used: its gain would be off by 2 % or more."""

Block = tuple[
    Complex[np.ndarray, "scan channel frequency"],
    Complex[np.ndarray, "scan frequency"],
    Bool[np.ndarray, "scan channel"],
]
"""Sweeps, their calibration sweeps and which channels are valid."""


class SweepSource(NamedTuple):
    """Recorded sweeps.

    Attributes:
        path: path of the recording, for messages.
        layout: layout of the sweeps.
        scans: number of scans.
        blocks: function that returns the scans in the given number of blocks.
    """

    path: Path
    layout: SweepLayout
    scans: int
    blocks: Callable[[int], Iterator[Block]]


def sweeps_of(path: Path) -> SweepSource:
    """Sweeps of a run folder, a drive log, or a recording of ROS messages. Positions are not needed.

    Raises:
        InputError: the file cannot be read, or has no stepped-frequency sweeps.
    """
    if path.is_dir() and not (path / "metadata.yaml").is_file():
        return _of_run(path)
    return _of_drive(path) if path.name.endswith(".h5") else _of_messages(path)


def _of_run(path: Path) -> SweepSource:
    reading = read_run(path)
    signals = signals_of_run(reading, own_lookup=False)
    layout = None if signals.radar is None else layout_of(signals.radar)
    if layout is None:
        found = "none" if signals.radar is None else "finished traces"
        raise InputError(path, "radar messages", "stepped-frequency sweeps (radar_sweep)", found)

    def scans() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        for raw, kept in zip(scan_frames(reading, "radar_sweep"), signals.scan_kept, strict=False):
            if kept:
                frame = decode(raw)
                rows = complex_rows(frame)
                yield rows[:-1], rows[-1], (int(frame.number("valid")) >> np.arange(len(rows) - 1) & 1).astype(bool)

    count = int(signals.scan_kept.sum())
    return SweepSource(path, layout, count, lambda blocks: _stacked(scans(), count, blocks))


def _of_drive(path: Path) -> SweepSource:
    with DriveLog.open(path) as log:
        known, scans = log.description.recording, log.scans
        if not isinstance(known, SweepRecording):
            raise InputError(path, "/radar/sweeps", "stepped-frequency sweeps", "traces")
        layout = SweepLayout(log.channels, known.frequencies_hz, known.group_delay_ns)

    def blocks(count: int) -> Iterator[Block]:
        with DriveLog.open(path) as log:
            for low, high in pairwise(_edges(scans, count)):
                yield log.read_sweeps(low, high)

    return SweepSource(path, layout, scans, blocks)


def _of_messages(path: Path) -> SweepSource:
    recording = open_recording(path)
    found = gather(recording)
    radar = radar_topic(recording, found, None)
    form = found.forms[radar.topic]
    if form.encoding != SWEEPS:
        raise InputError(path, f"{radar.topic}, encoding", f"{SWEEPS}, stepped-frequency sweeps", form.encoding)
    layout = layout_of_form(path, form, array_message(recording, found, None))

    def scans() -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        for scan in scans_of(recording, radar):
            assert scan.calibration is not None
            yield scan.signal, scan.calibration, scan.valid

    return SweepSource(path, layout, len(radar), lambda blocks: _stacked(scans(), len(radar), blocks))


def _edges(scans: int, blocks: int) -> list[int]:
    return [scans * number // blocks for number in range(blocks + 1)]


def _stacked(scans: Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]], count: int, blocks: int) -> Iterator[Block]:
    for size in np.diff(_edges(count, blocks)):
        sweeps, calibration, valid = (np.stack(part) for part in zip(*islice(scans, int(size)), strict=True))
        yield sweeps, calibration, valid


class _Extreme(NamedTuple):
    """Largest value of each part of the sweeps (real, imaginary, and their negatives), and the scans that reach it."""

    value: Float[np.ndarray, "part row frequency"]
    reached: Int[np.ndarray, "part row frequency"]

    @classmethod
    def of(cls, rows: Complex[np.ndarray, "scan row frequency"]) -> "_Extreme":
        parts = np.nan_to_num(np.stack([rows.real, rows.imag, -rows.real, -rows.imag]))
        value = parts.max(axis=1)
        return cls(value, np.sum(parts == value[:, None], axis=1))

    def joined(self, other: "_Extreme") -> "_Extreme":
        value = np.maximum(self.value, other.value)
        reached = np.where(self.value == value, self.reached, 0) + np.where(other.value == value, other.reached, 0)
        return _Extreme(value, reached)

    def saturated(self, scans: int) -> Bool[np.ndarray, "row frequency"]:
        """Sweep entries at the limit of the receiver: the largest value of all entries, reached again and again."""
        found = np.zeros(self.value.shape[1:], bool)
        for sign in (slice(0, 2), slice(2, 4)):
            value = self.value[sign]
            limit = (value == value.max()) & (self.reached[sign] >= _AT_LIMIT * scans)
            if np.count_nonzero(limit) >= _PLACES:
                found |= limit.any(axis=0)
        return found


class StandingSweeps(NamedTuple):
    """Sweeps of a stationary array, averaged over groups of consecutive scans.

    Attributes:
        layout: layout of the sweeps.
        scans: number of scans.
        ratio: sweeps divided by the calibration channel; NaN without a valid scan.
        calibration: sweeps of the calibration channel.
        noise: RMS noise of a single scan's ratio.
        calibration_noise: RMS noise of a single calibration sweep over its level.
        saturated: entries at the limit of the receiver; the calibration channel is the last row.
        dead: channels without a signal.
    """

    layout: SweepLayout
    scans: int
    ratio: Complex[np.ndarray, "group channel frequency"]
    calibration: Complex[np.ndarray, "group frequency"]
    noise: Float[np.ndarray, " channel"]
    calibration_noise: float
    saturated: Bool[np.ndarray, "row frequency"]
    dead: Bool[np.ndarray, " channel"]

    @property
    def mean(self) -> Complex[np.ndarray, "channel frequency"]:
        """Median of the groups' ratios; zero for dead channels."""
        live = np.where(self.dead[None, :, None], 0.0, self.ratio)
        return np.asarray(np.nanmedian(live.real, axis=0) + 1j * np.nanmedian(live.imag, axis=0))


def average_sweeps(sources: Sequence[SweepSource], progress: Callable[[int], None] = lambda _: None) -> StandingSweeps:
    """Average recordings of a standing array; all of them are read once.

    Raises:
        InputError: a recording has too few scans, sweeps of another layout than the first, or no live channel.
    """
    first = sources[0]
    ratios, calibrations, noises, extremes = [], [], [], []
    dead = np.zeros(first.layout.channels, bool)
    for source in sources:
        if not source.layout.agrees(first.layout):
            expected = f"{first.layout}, as in {first.path}"
            raise InputError(source.path, "sweeps", expected, str(source.layout))
        if source.scans < _LEAST_SCANS:
            raise InputError(source.path, "sweeps", f"at least {_LEAST_SCANS} scans", str(source.scans))
        head: list[Block] = []
        for sweeps, calibration, valid in source.blocks(_GROUPS):
            known = np.isfinite(calibration).all(axis=1) & (calibration != 0).all(axis=1)
            good = valid & known[:, None] & np.isfinite(sweeps).all(axis=2)
            divisor = np.where(known[:, None], calibration, 1.0).astype(np.complex128)
            ratio = np.where(good[..., None], sweeps, 0.0) / divisor[:, None]
            with np.errstate(invalid="ignore"):
                ratios.append(ratio.sum(axis=0) / good.sum(axis=0)[:, None])
                calibrations.append(np.where(known[:, None], calibration, 0.0).sum(axis=0) / known.sum())
            noises.append((_noise(ratio, good), _noise(divisor[:, None], known[:, None])))
            extremes.append(_Extreme.of(np.concatenate([sweeps, calibration[:, None]], axis=1)))
            if sum(len(block[0]) for block in head) < _LEAST_SCANS:
                head.append((np.where(good[..., None], sweeps, np.nan), calibration, valid))
            progress(len(sweeps))
        if np.isnan(np.stack(calibrations[-_GROUPS:])).all():
            raise InputError(source.path, "calibration channel", "a signal in every sweep", "zeros")
        dead |= find_dead_channels(*(np.concatenate(part) for part in list(zip(*head, strict=True))[:2]))
        dead |= np.isnan(np.stack(ratios[-_GROUPS:])).all(axis=(0, 2))
    if dead.all():
        raise InputError(first.path, "sweeps", "a channel with a signal", f"none of {len(dead)}")
    scans = sum(source.scans for source in sources)
    of_ratio, of_calibration = (np.stack(part) for part in zip(*noises, strict=True))
    mean = np.stack(calibrations)
    return StandingSweeps(
        layout=first.layout,
        scans=scans,
        ratio=np.stack(ratios),
        calibration=mean,
        noise=_rms_of(of_ratio),
        calibration_noise=float(_rms_of(of_calibration)[0] / np.sqrt(np.nanmean(np.abs(mean) ** 2))),
        saturated=reduce(_Extreme.joined, extremes).saturated(scans),
        dead=dead,
    )


def _noise(rows: Complex[np.ndarray, "scan row frequency"], good: Bool[np.ndarray, "scan row"]) -> np.ndarray:
    """RMS noise of each row, from second differences of neighbouring scans; NaN without three in succession."""
    together = good[2:] & good[1:-1] & good[:-2]
    difference = np.where(together[..., None], rows[2:] - 2.0 * rows[1:-1] + rows[:-2], 0.0)
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(np.mean(np.abs(difference) ** 2, axis=2).sum(axis=0) / together.sum(axis=0) / 6.0))


def _rms_of(noise: Float[np.ndarray, "group row"]) -> Float[np.ndarray, " row"]:
    """Median of the groups; of a row without any the infinite noise."""
    return np.array([np.median(own[np.isfinite(own)]) if np.isfinite(own).any() else np.inf for own in noise.T])


def _rms(values: np.ndarray) -> np.ndarray:
    """Root mean square over frequency."""
    return np.asarray(np.sqrt(np.mean(np.abs(values) ** 2, axis=-1)))


def _db(ratio: np.ndarray | float) -> float:
    return float(20.0 * np.log10(np.maximum(np.max(ratio), 1e-12)))


def check_sweeps(standing: StandingSweeps) -> list[HealthFigure]:
    """Checks of a recording of a standing array, causes first: saturation, noise, dead channels, drift."""
    live = ~standing.dead
    known = standing.calibration[np.isfinite(standing.calibration).all(axis=1)]
    typical = np.mean(known, axis=0)
    against = known @ np.conj(typical) / np.sum(np.abs(typical) ** 2)
    level, mean = _rms(standing.mean)[live], standing.mean[live]
    # Twice the noise of a group's average does not count as a change.
    noise2 = standing.noise[live] ** 2 * len(standing.ratio) / standing.scans
    change2 = np.nanmax(_rms(standing.ratio[:, live] - mean) ** 2, axis=0) - 2.0 * noise2
    limited = np.asarray(standing.saturated.any(axis=1))
    calibration = "; calibration channel" if limited[-1] else ""
    return [
        figure(
            "saturation",
            100.0 * float(np.mean(standing.saturated)),
            "%",
            (1e-3, 0.5),
            f"sweep entries at the limit of the receiver{_of_channels(limited[:-1])}{calibration}",
        ),
        figure(
            "calibration_noise",
            _db(standing.calibration_noise),
            "dB",
            (-40.0, -20.0),
            "noise of a calibration sweep over its level",
        ),
        figure(
            "noise_floor",
            _db(standing.noise[live] / level / np.sqrt(standing.scans)),
            "dB",
            (-60.0, -40.0),
            "noise left in the average of the noisiest live channel over its level: record longer",
        ),
        figure(
            "dead_channels",
            float(standing.dead.sum()),
            "channels",
            _some_of(len(standing.dead)),
            f"channels without a signal, which are not used{_of_channels(standing.dead)}",
        ),
        figure(
            "calibration_drift",
            _db(np.abs(against).max() / np.abs(against).min()),
            "dB",
            (1.0, 3.0),
            "largest over smallest magnitude of the calibration channel",
        ),
        figure(
            "calibration_phase",
            float(np.degrees(np.ptp(np.unwrap(np.angle(against))))),
            "deg",
            (15.0, 60.0),
            "range of the calibration channel's phase",
        ),
        figure(
            "remaining_drift",
            100.0 * float(np.max(np.sqrt(np.maximum(change2, 0.0)) / level)),
            "%",
            (1.0, 5.0),
            "largest change of a channel after division by the calibration channel: array or surroundings moved",
        ),
    ]


def _some_of(channels: int) -> tuple[float, float]:
    """Limits of a number of channels: one, and a quarter of the array but at least two."""
    return 1.0, max(2.0, float(np.ceil(channels / 4.0)))


def _of_channels(chosen: Bool[np.ndarray, " channel"]) -> str:
    """Numbers of some channels, for a sentence."""
    return f": channel {', '.join(map(str, np.flatnonzero(chosen)))}" if chosen.any() else ""


class Calibrated(NamedTuple):
    """A calibration and its checks.

    Attributes:
        known: calibration.
        checks: health figures of its recording.
        standing: averaged sweeps.
        echo: echo of the plate minus the look-up, for a calibration over a plate; zero for invalid channels.
    """

    known: SweepRecording
    checks: list[HealthFigure]
    standing: StandingSweeps
    echo: Complex[np.ndarray, "channel frequency"] | None = None


def lookup_of(standing: StandingSweeps) -> Calibrated:
    """Look-up from sweeps of an array pointed at empty space."""
    path = np.nanmedian(standing.calibration.real, axis=0) + 1j * np.nanmedian(standing.calibration.imag, axis=0)
    known = SweepRecording(
        frequencies_hz=standing.layout.frequencies_hz,
        lookup_sweeps=(standing.mean * path).astype(np.complex64),
        lookup_calibration_sweep=path.astype(np.complex64),
        group_delay_ns=standing.layout.group_delay_ns,
        channel_valid=~standing.dead,
    )
    return Calibrated(known, check_sweeps(standing), standing)


def response_of(standing: StandingSweeps, lookup: SweepRecording, place: Path) -> Calibrated:
    """Gain and delay of each channel from sweeps over a metal plate that is equally far from all channels.

    Channels whose echo disagrees with the others are not used.

    Args:
        standing: sweeps over the plate.
        lookup: look-up of the same array in empty space.
        place: path of the recording, for messages.

    Raises:
        InputError: no channel has a signal in both.
    """
    empty = lookup.lookup_sweeps.astype(np.complex128) / lookup.lookup_calibration_sweep
    missing = standing.dead | (np.zeros_like(standing.dead) if lookup.channel_valid is None else ~lookup.channel_valid)
    if missing.all():
        expected = "a channel with a signal here and in the look-up"
        raise InputError(place, "sweeps", expected, f"none of {len(missing)}")
    echo, frequencies_hz = standing.mean - empty, lookup.frequencies_hz
    disagrees = np.zeros_like(missing)
    # The second time without channels that disagree.
    for _ in range(2):
        out = missing | disagrees
        if out.all():
            break
        response = estimate_channel_response(echo, frequencies_hz, out)
        delay_ns = np.asarray(response.delay_ns)
        aligned = echo * np.exp(2e-9j * np.pi * np.outer(delay_ns, frequencies_hz))
        typical = aligned[~out].mean(axis=0)
        agreement = np.real(aligned @ np.conj(typical)) / np.maximum(
            _rms(aligned) * _rms(typical) * len(typical), 1e-30
        )
        disagrees = disagrees | ~missing & (agreement < _AGREES)
    checks = [
        *(each for each in check_sweeps(standing) if each.name != "dead_channels"),
        figure(
            "dead_channels",
            float(missing.sum()),
            "channels",
            _some_of(len(missing)),
            f"channels without a signal here or in the look-up, which are not used{_of_channels(missing)}",
        ),
        figure(
            "plate_echo",
            float(20.0 * np.log10(np.median(_rms(echo[~missing]) / _rms(empty[~missing])))),
            "dB",
            (-15.0, -25.0),
            "echo of the plate over the direct coupling",
        ),
        figure(
            "disagreeing_channels",
            float(disagrees.sum()),
            "channels",
            _some_of(len(missing)),
            f"channels whose echo correlates with the array's by less than {_AGREES}, which are not used"
            + _of_channels(disagrees),
        ),
    ]
    known = replace(
        lookup,
        channel_gain=np.asarray(response.gain, np.float64),
        channel_delay_ns=np.asarray(response.delay_ns, np.float64),
        channel_valid=~(missing | disagrees),
    )
    return Calibrated(known, checks, standing, np.where((missing | disagrees)[:, None], 0.0, echo))


def refuse_bad(path: Path, checks: Sequence[HealthFigure]) -> None:
    """Raise ``InputError`` for the first check whose verdict is bad."""
    for each in checks:
        if each.verdict == "bad":
            bound = f"{'below' if each.bad >= each.look else 'above'} {each.bad:g} {each.unit}"
            raise InputError(path, each.name, f"{bound} ({each.meaning})", f"{each.value:.3g} {each.unit}")
