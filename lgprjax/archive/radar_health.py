"""Figures of a drive's radar: channels, saturation, gain, noise, interference."""

import numpy as np
from jaxtyping import Float

from lgprjax.archive.noise_health import interference, noise
from lgprjax.archive.signal_blocks import SignalBlocks
from lgprjax.archive.verdicts import Findings, HealthFigure, Places, figure, median_of

_DEAD = 0.1  # of the array's level: 20 dB below


def radar_figures(
    blocks: SignalBlocks, time_s: Float[np.ndarray, " scan"], path_m: Float[np.ndarray, " scan"]
) -> Findings:
    """Figures of the signal itself.

    Args:
        blocks: the recording, reduced.
        time_s: of the scans.
        path_m: metres travelled since the first scan.
    """
    place = Places(blocks.first, time_s, path_m)
    figures: list[HealthFigure] = []
    missing: list[tuple[str, str]] = []
    for measure in (_channels, _validity, _saturation, _gain, noise, interference):
        found, lacking = measure(blocks, place)
        figures += found
        missing += lacking
    return figures, missing


def _channels(blocks: SignalBlocks, place: Places) -> Findings:
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
            "channels without a direct wave (20 dB below the array's) or without any valid trace, part of the drive",
            place.of_channels(dead),
        ),
        figure(
            "stuck_channel",
            float(stuck.max()),
            "%",
            (0.5, 5.0),
            "traces that repeat the one before sample by sample, of the channel that does so most",
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


def _validity(blocks: SignalBlocks, place: Places) -> Findings:
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
            "scans with samples that are no numbers",
            place.of(blocks.non_finite > 0),
        ),
    ], []


def _saturation(blocks: SignalBlocks, place: Places) -> Findings:
    if blocks.recorded.rails is None:
        why = "the stored type has no rails that a receiver reaches"
        return [], [(name, why) for name in ("clipped_traces", "clipped_direct_wave")]
    share = blocks.clipped / np.maximum(blocks.used, 1.0)
    return [
        figure(
            "clipped_traces",
            100.0 * float(blocks.clipped.sum() / max(blocks.used.sum(), 1.0)),
            "%",
            (0.5, 5.0),
            "traces with samples at the rails of the stored type, the direct wave left out",
            place.of_channels(share >= 0.005),
        ),
        figure(
            "clipped_direct_wave",
            blocks.clipped_direct / blocks.recorded.period_samples,
            "periods",
            (0.25, 1.0),
            "time that a trace's direct wave spends at the rails, in periods of the centre frequency",
        ),
    ], []


def _gain(blocks: SignalBlocks, place: Places) -> Findings:
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
        # Over quarters: an antenna on the ground hears its direct wave change with the ground from metre to metre.
        figure(
            "gain_drift",
            100.0 * float(np.nanmax(quarter) - np.nanmin(quarter)),
            "%",
            (10.0, 40.0),
            "level of the array's direct wave: largest less smallest median of a quarter of the drive",
            place.of(np.abs(drift) >= 0.05),
        ),
        figure(
            "direct_wave_change",
            100.0 * float(np.nanmax(np.abs(change))),
            "%",
            (35.0, 60.0),
            "farthest that the array's direct wave departs from its median anywhere",
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
            "farthest that a live channel's direct wave departs from its own median against the array",
            place.of_channels(wide),
        )
    )
    return figures, []
