"""Figures of a drive's radar: channels, saturation, gain, noise, interference."""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float

from lgprjax.formats import DriveLog, SweepRecording
from lgprjax.recordings.signals import (
    RecordingTraits,
    SignalBlocks,
    SignalReducer,
    block_edges,
    interference,
    line_db,
    noise,
    regular_scans,
)
from lgprjax.recordings.verdicts import BlockStretches, Findings, HealthFigure, figure, median_of

_DEAD = 0.1  # of the array's level: 20 dB below


def radar_figures(
    blocks: SignalBlocks, time_s: Float[np.ndarray, " scan"], path_m: Float[np.ndarray, " scan"]
) -> Findings:
    """Figures of the signal itself.

    Args:
        blocks: levels of the recording.
        time_s: scan times.
        path_m: metres travelled since the first scan.
    """
    place = BlockStretches(blocks.first, time_s, path_m)
    figures: list[HealthFigure] = []
    missing: list[tuple[str, str]] = []
    for measure in (_channels, _validity, _saturation, _gain, noise, interference):
        found, lacking = measure(blocks, place)
        figures += found
        missing += lacking
    return figures, missing


def _channels(blocks: SignalBlocks, place: BlockStretches) -> Findings:
    seen = np.asarray(blocks.used > 0)
    typical = float(np.median(blocks.level[seen])) if seen.any() else 0.0
    silent = np.asarray(~seen.any(axis=0))
    dead = np.asarray((seen & (blocks.level <= _DEAD * typical)) | silent[None, :])
    share = blocks.repeated / np.maximum(blocks.used, 1.0)
    stuck = 100.0 * blocks.repeated.sum(axis=0) / np.maximum(blocks.used.sum(axis=0), 1.0)
    figures = [
        figure(
            "dead_channels",
            float(dead.any(axis=0).sum()),
            "channels",
            (1.0, 1.0),
            "channels without a direct wave (20 dB below the array's) or without any valid trace, share of the drive",
            place.of_channels(dead),
        ),
        figure(
            "stuck_channel",
            float(stuck.max()),
            "%",
            (0.5, 5.0),
            "traces identical to the previous one, in the channel with the most",
            place.of_channels(share >= 0.005),
        ),
    ]
    live = np.asarray(~dead.any(axis=0))
    if live.sum() < 3:
        few = "needs three live channels"
        return figures, [(name, few) for name in ("weak_channel", "polarity")]
    own = np.array([np.median(level[ok]) for level, ok in zip(blocks.level.T, seen.T, strict=True) if ok.any()])
    level = np.full(len(live), np.nan)
    level[~silent] = own
    ratio_db = 20.0 * np.log10(np.maximum(level, 1e-30) / np.median(level[live]))
    weak = live & (ratio_db <= -6.0)
    turned = live & (blocks.polarity <= 0.7)
    figures += [
        figure(
            "weak_channel",
            float(ratio_db[live].min()),
            "dB",
            (-6.0, -12.0),
            "level of the weakest live channel's direct wave over the array's median",
            place.of_channels(seen & weak[None]),
        ),
        figure(
            "polarity",
            float(blocks.polarity[live].min()),
            "",
            (0.7, 0.0),
            "least correlation of a live channel's direct wave with the array's; below zero: opposite polarity",
            place.of_channels(seen & turned[None]),
        ),
    ]
    return figures, []


def _validity(blocks: SignalBlocks, place: BlockStretches) -> Findings:
    scans = np.diff(blocks.first)
    return [
        figure(
            "invalid_scans",
            100.0 * float(blocks.invalid.sum() / scans.sum()),
            "%",
            (1.0, 10.0),
            "scans with a channel marked invalid",
            place.of(blocks.invalid > 0),
        ),
        figure(
            "non_finite_scans",
            100.0 * float(blocks.non_finite.sum() / scans.sum()),
            "%",
            (0.05, 1.0),
            "scans with samples that are not numbers",
            place.of(blocks.non_finite > 0),
        ),
    ], []


def _saturation(blocks: SignalBlocks, place: BlockStretches) -> Findings:
    if blocks.recorded.rails is None:
        why = "the stored data type has no saturation limit"
        return [], [(name, why) for name in ("clipped_traces", "clipped_direct_wave")]
    share = blocks.clipped / np.maximum(blocks.used, 1.0)
    return [
        figure(
            "clipped_traces",
            100.0 * float(blocks.clipped.sum() / max(blocks.used.sum(), 1.0)),
            "%",
            (0.5, 5.0),
            "traces with samples at the limits of the stored type, without the direct wave",
            place.of_channels(share >= 0.005),
        ),
        figure(
            "clipped_direct_wave",
            blocks.clipped_direct / blocks.recorded.period_samples,
            "periods",
            (0.25, 1.0),
            "duration of clipping in the direct wave of a trace, in periods of the centre frequency",
        ),
    ], []


def _gain(blocks: SignalBlocks, place: BlockStretches) -> Findings:
    size = np.where(blocks.used > 0, np.abs(blocks.direct), np.nan)
    own = median_of(size)
    live = own > _DEAD * float(np.nanmedian(own)) if np.isfinite(own).any() else np.zeros(len(own), bool)
    if not live.any():
        return [], [("gain_drift", "no direct wave")]
    relative = size[:, live] / own[live]
    array = median_of(relative.T)
    part = np.array_split(array, min(4, len(array)))
    quarter = np.array([np.nanmedian(values) if np.isfinite(values).any() else np.nan for values in part])
    drift = np.concatenate([np.full(len(values), level - 1.0) for values, level in zip(part, quarter, strict=True)])
    change = array / np.nanmedian(array) - 1.0
    figures = [
        # Over quarters: the direct wave of an antenna on the ground changes with the ground from metre to metre.
        figure(
            "gain_drift",
            100.0 * float(np.nanmax(quarter) - np.nanmin(quarter)),
            "%",
            (10.0, 40.0),
            "level of the array's direct wave: largest minus smallest median over quarters of the drive",
            place.of(np.abs(drift) >= 0.05),
        ),
        figure(
            "direct_wave_change",
            100.0 * float(np.nanmax(np.abs(change))),
            "%",
            (35.0, 60.0),
            "largest deviation of the array's direct wave from its median",
            place.of(np.abs(np.nan_to_num(change)) >= 0.35),
        ),
    ]
    if live.sum() < 3:
        return figures, [("channel_drift", "needs three live channels")]
    apart = relative / array[:, None] - 1.0
    wide = np.zeros(size.shape, bool)
    wide[:, live] = np.abs(apart) >= 0.1
    figures.append(
        figure(
            "channel_drift",
            100.0 * float(np.nanmax(np.abs(apart))),
            "%",
            (20.0, 40.0),
            "largest deviation of a live channel's direct wave from its own median, relative to the array",
            place.of_channels(wide),
        )
    )
    return figures, []


# Health figures of stepped-frequency sweeps: calibration channel, noise by frequency, time profiles.

_NARROW = 25.0  # power of one frequency's noise over its block's median that no Gaussian noise reaches


class SweepLevels(NamedTuple):
    """Levels that only sweeps have, one row per block.

    Attributes:
        calibration: mean calibration sweep divided by that of the look-up sweeps; NaN without any.
        calibration_noise: RMS of its noise over its level.
        narrow: scans with unusual noise at single frequencies.
        spectrum: power of the channels' noise over frequency.
    """

    calibration: Complex[np.ndarray, " block"]
    calibration_noise: Float[np.ndarray, " block"]
    narrow: Float[np.ndarray, " block"]
    spectrum: Float[np.ndarray, " frequency"]


def sweep_blocks(log: DriveLog, progress: Callable[[int], None]) -> tuple[SignalBlocks, SweepLevels]:
    """Reduce a log of sweeps; its signal as time profiles, calibrated scan by scan.

    A channel's sweep is multiplied by the look-up calibration sweep over its own scan's: drift of cables and converter
    since then cancels (LL, calibration order). Raises ``InputError`` for damaged data.
    """
    recording = log.description.recording
    assert isinstance(recording, SweepRecording)
    known = recording.lookup_calibration_sweep.astype(np.complex128)
    band_hz = np.ptp(recording.frequencies_hz) * log.samples / (log.samples - 1)
    reducer = SignalReducer(
        log.channels, RecordingTraits(log.samples, 1e9 / band_hz, float(np.mean(recording.frequencies_hz)), None, 0.0)
    )
    taper = np.hanning(log.samples + 2)[1:-1]
    regular, edges = regular_scans(log.scan_time_s), block_edges(log.scans)
    spectrum = np.zeros(log.samples)
    rows = []
    for start, stop in pairwise(edges):
        before = log.non_finite_scans
        sweeps, calibration, valid = log.read_sweeps(start, stop)
        sound = (np.abs(calibration) > 0.0).any(axis=1)
        valid = valid & sound[:, None]
        steady = np.where(sound[:, None], calibration, known)
        # A frequency at which the calibration path has no signal cannot be corrected and is left out.
        floor = 1e-3 * np.abs(steady).max(axis=1, keepdims=True)
        correction = np.where(np.abs(steady) > floor, known / np.where(np.abs(steady) > floor, steady, 1.0), 0.0)
        clean = np.where(valid[..., None], sweeps, 0.0)
        profile = np.fft.ifft(clean * (correction * taper)[:, None, :], axis=2)
        reducer.feed(profile, valid, log.non_finite_scans - before, regular[start:stop])
        power, narrow = _by_frequency(clean, valid, regular[start:stop])
        spectrum += power
        rows.append((*_calibration(calibration, sound, known), narrow))
        progress(stop - start)
    ratio, noise, narrow_scans = (np.asarray(column) for column in zip(*rows, strict=True))
    return reducer.result(edges), SweepLevels(ratio, noise, narrow_scans.astype(np.float64), spectrum)


def sweep_figures(
    blocks: SignalBlocks,
    levels: SweepLevels,
    time_s: Float[np.ndarray, " scan"],
    path_m: Float[np.ndarray, " scan"],
) -> list[HealthFigure]:
    """Figures that exist for sweeps only.

    Args:
        blocks, levels: levels of the recording.
        time_s: scan times.
        path_m: metres travelled since the first scan.
    """
    place = BlockStretches(blocks.first, time_s, path_m)
    seen = np.isfinite(levels.calibration) & (np.abs(levels.calibration) > 0.0)
    if not seen.any():
        return [figure("calibration_drift", np.nan, "dB", (1.0, 3.0), "no finite calibration sweep")]
    ratio = np.where(seen, levels.calibration, np.nan)
    level_db = 20.0 * np.log10(np.abs(ratio) / np.nanmedian(np.abs(ratio)))
    first = ratio[np.flatnonzero(seen)[0]]
    turn = np.full(len(ratio), np.nan)
    turn[seen] = np.degrees(np.unwrap(np.angle(ratio[seen] / first)))
    left = np.where(blocks.used > 0, blocks.direct, np.nan)
    remains = np.full(len(ratio), np.nan)
    for number, row in enumerate(left):
        reference = np.conj(left[np.flatnonzero(seen)[0]])
        product = (row * reference)[np.isfinite(row) & np.isfinite(reference)]
        remains[number] = np.degrees(np.angle(product.sum())) if len(product) else np.nan
    noise_db = 20.0 * np.log10(np.maximum(levels.calibration_noise, 1e-12))
    scans = np.diff(blocks.first)
    return [
        figure(
            "calibration_drift",
            float(np.ptp(level_db[seen])),
            "dB",
            (1.0, 3.0),
            "largest over smallest magnitude of the calibration channel over the drive",
            place.of(np.abs(np.nan_to_num(level_db)) >= 0.5),
        ),
        figure(
            "calibration_phase",
            float(np.ptp(turn[seen])),
            "deg",
            (15.0, 60.0),
            "range of the calibration channel's phase over the drive",
            place.of(np.abs(np.nan_to_num(turn)) >= 7.5),
        ),
        figure(
            "remaining_phase",
            float(np.ptp(remains[np.isfinite(remains)])) if np.isfinite(remains).any() else np.nan,
            "deg",
            (10.0, 30.0),
            "range of the direct wave's phase over the drive after dividing by the calibration channel",
            place.of(np.abs(np.nan_to_num(remains)) >= 5.0),
        ),
        figure(
            "calibration_noise",
            float(np.nanmedian(noise_db)),
            "dB",
            (-40.0, -20.0),
            "noise of a calibration sweep over its level (receiver noise without ground)",
            place.of(np.nan_to_num(noise_db, nan=-np.inf) >= -40.0),
        ),
        figure(
            "narrow_bursts",
            100.0 * float(levels.narrow.sum() / scans.sum()),
            "%",
            (1.0, 5.0),
            "scans with noise 14 dB above the median at single frequencies",
            place.of(levels.narrow > 0),
        ),
        figure(
            "narrow_line",
            line_db(levels.spectrum),
            "dB",
            (10.0, 20.0),
            "strongest single frequency of the sweeps' noise over the median of its neighbours",
        ),
    ]


def _calibration(
    sweeps: Complex[np.ndarray, "scan frequency"], sound: Bool[np.ndarray, " scan"], known: np.ndarray
) -> tuple[complex, float]:
    """Mean calibration sweep over the known one, and its noise over its level; NaN without enough scans."""
    good = sweeps[sound].astype(np.complex128)
    if not len(good):
        return complex(np.nan, np.nan), np.nan
    ratio = complex(np.vdot(known, good.mean(axis=0)) / max(float(np.vdot(known, known).real), 1e-30))
    if len(good) < 3:
        return ratio, np.nan
    difference = (good[2:] - 2.0 * good[1:-1] + good[:-2]) / np.sqrt(6.0)
    level = float(np.sqrt(np.mean(np.abs(good) ** 2)))
    return ratio, float(np.sqrt(np.mean(np.abs(difference) ** 2))) / max(level, 1e-30)


def _by_frequency(
    sweeps: Complex[np.ndarray, "scan channel frequency"],
    valid: Bool[np.ndarray, "scan channel"],
    regular: Bool[np.ndarray, " scan"],
) -> tuple[Float[np.ndarray, " frequency"], int]:
    """Power of the scans' differences at every frequency, and the scans with an outlier at a single one."""
    if len(sweeps) < 3:
        return np.zeros(sweeps.shape[2]), 0
    together = valid[2:] & valid[1:-1] & valid[:-2] & (regular[2:] & regular[1:-1])[:, None]
    difference = np.where(together[..., None], sweeps[2:] - 2.0 * sweeps[1:-1] + sweeps[:-2], 0.0)
    power = np.abs(difference.astype(np.complex128)) ** 2 / 6.0
    usual = np.median(power, axis=0, keepdims=True)
    # A wide-band disturbance (a jolt, a gap) raises all frequencies alike and is no interference.
    beside = np.median(power, axis=2, keepdims=True)
    narrow = (power > _NARROW * np.maximum(usual, 1e-30)) & (power > _NARROW * np.maximum(beside, 1e-30))
    return power.sum(axis=(0, 1)), int(narrow.any(axis=(1, 2)).sum())
