"""What is recorded: noise and its band, gain with time, eight bits, and each fault where it was put."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene import NO_FAULTS, Day, RadarConfig, ReceiverConfig, SimulatedDrive, render_drive, time_gain
from scene.bare_ground import INDEX, LIGHT_M_PER_NS, SPOTLESS
from scene.short_drives import EMPTY, FLAT_GAIN, GROUND, SOFT_GAIN, drive_over, recorded

LATE = slice(150, 369)  # after the last of coupling and surface
NOISY = replace(SPOTLESS, noise_field=3e-3)
NOISE_COUNTS = 3e-3 * 7e4 * 0.3**2


def late_part(drive: SimulatedDrive) -> Float[np.ndarray, "scan channel sample"]:
    """What changes from scan to scan; the tails of coupling and surface do not."""
    late = recorded(drive)[..., LATE]
    return np.asarray(late - np.median(late, axis=0))


def noise_of(day: Day = NOISY, seed: int = 3) -> Float[np.ndarray, "scan channel sample"]:
    late = recorded(drive_over(EMPTY, day, seed, receiver=FLAT_GAIN))[..., LATE]
    return np.asarray(late - late.mean(axis=0))


def test_noise_is_as_loud_as_asked_and_silent_outside_the_band() -> None:
    noise = noise_of()
    np.testing.assert_allclose(np.sqrt(np.mean(noise**2)), NOISE_COUNTS, rtol=0.05)
    power = np.mean(np.abs(np.fft.rfft(noise * np.hanning(219), 512)) ** 2, axis=(0, 1))
    frequency_mhz = np.fft.rfftfreq(512, 0.16e-3)
    outside = (frequency_mhz < 50) | (frequency_mhz > 450)  # the window's own width is 57 MHz
    assert power[outside].sum() < 1e-3 * power.sum()


def test_every_scan_channel_and_drive_has_its_own_noise() -> None:
    first, other_drive, other_day = noise_of(), noise_of(seed=4), noise_of(replace(NOISY, seed=2))
    level = np.mean(first**2)
    for one, other in [
        (first, other_drive),
        (first, other_day),
        (first[1:], first[:-1]),
        (first[64:], first[: len(first) - 64]),  # the next block
        (first[:, 1:], first[:, :-1]),
    ]:
        assert abs(np.mean(one * other)) < 0.06 * level  # 1.3 % by chance


def test_the_time_gain_undoes_the_loss_of_depth() -> None:
    gain = time_gain(RadarConfig(), ReceiverConfig())
    for range_m in (0.3, 1.2, 1.8):
        at = (2 * 0.3 / LIGHT_M_PER_NS + 2 * range_m / 0.1 + 4.0) / 0.16
        loss = np.exp(-1.4 * range_m) / (0.3 + range_m / INDEX) ** 2
        assert np.interp(at, np.arange(369), gain) * loss == pytest.approx(900.0, rel=2e-3)
    assert np.all(np.diff(gain) >= 0)
    limited = time_gain(RadarConfig(), ReceiverConfig(gain_limit=20.0))
    assert limited.max() == pytest.approx(20.0 * limited[0])


def test_the_time_gain_multiplies_what_was_heard() -> None:
    """The same noise with gain over time and without differs by the gain, but for two roundings."""
    day = replace(SPOTLESS, noise_field=6e-4)
    plain = recorded(drive_over(EMPTY, day, receiver=FLAT_GAIN))[..., LATE]
    risen = recorded(drive_over(EMPTY, day))[..., LATE]
    gain = time_gain(RadarConfig(), ReceiverConfig())[LATE] / time_gain(RadarConfig(), FLAT_GAIN)[LATE]
    assert gain.max() > 3.0
    whole = (np.abs(plain) < 127) & (np.abs(risen) < 127)
    assert whole.mean() > 0.9
    assert np.all((np.abs(risen - plain * gain) <= 0.501 + 0.501 * gain)[whole])
    assert risen[whole].std() > 5.0


def test_what_is_too_loud_is_clipped_not_wrapped_and_gain_drifts() -> None:
    drifting = recorded(drive_over(EMPTY, faults=replace(NO_FAULTS, gain_drift=0.3), receiver=SOFT_GAIN))
    peak = np.ptp(drifting, axis=-1)
    assert np.all(peak[-1] / peak[0] == pytest.approx(1.3, abs=0.02))
    soft, loud = (recorded(drive_over(EMPTY, receiver=receiver)) for receiver in (SOFT_GAIN, FLAT_GAIN))
    assert 35 < np.abs(soft).max() < 90
    strong = np.abs(soft) > 3  # 140 times as loud
    np.testing.assert_array_equal(loud[strong], np.where(soft[strong] > 0, 127, -128))


def test_a_loud_scan_is_four_times_itself() -> None:
    drives = [
        drive_over(EMPTY, faults=replace(NO_FAULTS, clipped_share=share), receiver=SOFT_GAIN) for share in (0.0, 0.3)
    ]
    quiet, loud = (recorded(drive) for drive in drives)
    hit = drives[1].errors.gain > 2
    assert 10 < hit.sum() < 100
    np.testing.assert_array_equal(loud[~hit], quiet[~hit])
    inside = np.abs(quiet[hit]) < 30
    assert np.abs((loud[hit] - 4.0 * quiet[hit])[inside]).max() <= 2.5
    assert np.all(np.abs(loud[hit][np.abs(quiet[hit]) > 34]) >= 127)


def test_interference_is_a_tone_in_its_share_of_the_scans() -> None:
    faults = replace(NO_FAULTS, interference_share=0.2, interference_field=0.01)
    drive = drive_over(EMPTY, faults=faults, receiver=FLAT_GAIN)
    hit = drive.errors.interference > 0
    late = late_part(drive)
    assert 10 < hit.sum() < 50
    assert np.abs(late[~hit]).max() <= 1
    strong = np.flatnonzero((drive.errors.interference > 0.003) & (drive.errors.interference < 0.012))
    assert len(strong) > 4
    for scan in strong:
        amplitude = drive.errors.interference[scan] * 7e4 * 0.3**2
        assert np.abs(late[scan]).max() == pytest.approx(amplitude, rel=0.05, abs=1.5)
        spectrum = np.abs(np.fft.rfft(late[scan] * np.hanning(219), 8192))
        tone_mhz = np.fft.rfftfreq(8192, 0.16e-3)[np.argmax(spectrum, axis=-1)]
        np.testing.assert_allclose(tone_mhz, drive.errors.interference_mhz[scan], atol=4.0)


def test_a_dead_channel_records_noise_alone() -> None:
    faults = replace(NO_FAULTS, dead_channels=(1,), interference_share=0.2, interference_field=0.01)
    counts = recorded(drive_over(EMPTY, NOISY, faults=faults, receiver=FLAT_GAIN))
    assert counts[:, 1].std() == pytest.approx(NOISE_COUNTS, rel=0.05)
    assert np.abs(counts[:, 1]).max() < 127
    assert np.ptp(counts[:, 0, :60], axis=-1).min() > 200


def test_dropped_scans_leave_gaps_and_the_others_as_they_were() -> None:
    whole, gappy = (drive_over(GROUND, faults=replace(NO_FAULTS, dropped_share=s)) for s in (0.0, 0.1))
    kept = np.isin(whole.scan_time_s, gappy.scan_time_s)
    assert 3 < (~kept).sum() < 30
    gaps = np.diff(gappy.scan_time_s) * 126
    np.testing.assert_allclose(gaps, np.round(gaps), atol=1e-9)
    assert round(float(np.sum(gaps - 1))) == (~kept).sum()
    np.testing.assert_array_equal(gappy.road_antenna_m, whole.road_antenna_m[kept])
    difference = render_drive(gappy).astype(int) - render_drive(whole).astype(int)[kept]
    assert np.abs(difference).max() <= 1  # in other blocks, so about other origins
    assert np.mean(difference == 0) > 0.999
