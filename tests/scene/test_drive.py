"""A recorded drive: the same from its seeds, in any chunks, from one program, seen from both ends."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar.array import uniform_array
from lgprjax.scene import (
    Day,
    DrivePlan,
    GroundConfig,
    RadarConfig,
    ReceiverConfig,
    Response,
    iterate_traces,
    make_ground,
    record_scans,
    render_drive,
    simulate_drive,
    time_gain,
)

GROUND = make_ground(1, GroundConfig(length_m=30.0))
EMPTY = make_ground(1, GroundConfig(length_m=30.0, stones_per_m2=0.0, layer_reflectivity=0.0))
PLAN = DrivePlan(0.0, 12.0)
SPOTLESS = Day(
    seed=1,
    noise_field=0.0,
    gain_spread=0.0,
    delay_spread_ns=0.0,
    coupling_spread=0.0,
    velocity_spread=0.0,
    clutter_per_m2=0.0,
)


def test_the_same_seeds_record_the_same_bytes() -> None:
    first, again = (render_drive(simulate_drive(GROUND, PLAN, Day(seed=2), 3)) for _ in range(2))
    other = render_drive(simulate_drive(GROUND, PLAN, Day(seed=3), 3))
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize("chunk_scans", [1, 50, 64, 200, 10_000])
def test_chunks_never_change_the_bytes(chunk_scans: int) -> None:
    drive = simulate_drive(GROUND, PLAN, Day(), 3)
    chunks = list(iterate_traces(drive, chunk_scans))
    assert all(len(chunk) == chunk_scans for chunk in chunks[:-1])
    assert 0 < len(chunks[-1]) <= chunk_scans
    np.testing.assert_array_equal(np.concatenate(chunks), render_drive(drive))
    assert len(drive.scan_time_s) == sum(len(chunk) for chunk in chunks)


def test_one_compiled_program_serves_a_drive_and_the_next() -> None:
    compiled = record_scans._cache_size  # type: ignore[attr-defined]
    before = compiled()
    # A shape no other test uses, so that the count is this test's own.
    array = uniform_array(5, 0.2, x_m=1.0, height_m=0.3)
    for seed in (1, 2):
        drive = simulate_drive(GROUND, PLAN, Day(seed=seed), seed, array=array)
        assert len(list(iterate_traces(drive, 100))) == 4
    assert compiled() == before + 1


def test_the_way_back_sees_the_same_ground_mirrored() -> None:
    array = uniform_array(11, 0.127, height_m=0.3)  # above the rear axle, all channels at once
    still = replace(PLAN, wander_m=0.0, scan_rate_hz=100.0, speed_mps=5.0)  # a scan every 5 cm, at both ends too
    there = simulate_drive(GROUND, still, SPOTLESS, 4, array=array)
    back = simulate_drive(GROUND, replace(still, direction=-1), SPOTLESS, 4, array=array)
    np.testing.assert_allclose(back.antenna_m[::-1, ::-1], there.antenna_m, atol=1e-9)
    outward = render_drive(there._replace(response=_uniform(there.response))).astype(np.int32)
    homeward = render_drive(back._replace(response=_uniform(back.response))).astype(np.int32)
    assert np.abs(homeward[::-1, ::-1] - outward).max() <= 1
    assert np.mean(homeward[::-1, ::-1] == outward) > 0.99


def test_velocity_moves_deep_echoes_later_and_leaves_the_surface() -> None:
    dry = render_drive(simulate_drive(GROUND, PLAN, SPOTLESS, 3)).astype(np.float64) - 128
    wet_day = replace(SPOTLESS, velocity_factor=0.97)
    wet = render_drive(simulate_drive(GROUND, PLAN, wet_day, 3)).astype(np.float64) - 128
    dry, wet = dry - dry.mean(axis=0), wet - wet.mean(axis=0)
    at = np.arange(369) * 0.16 - 4.0
    surface_ns = 2 * 0.3 / 0.299792458
    stretched = surface_ns + (at - surface_ns) * 0.97  # where the dry trace holds what arrives at `at`
    source = np.interp(stretched, at, np.arange(369.0))
    low = np.clip(source.astype(int), 0, 367)
    moved = dry[..., low] * (1 - (source - low)) + dry[..., low + 1] * (source - low)
    deep = slice(150, 340)
    assert _correlation(moved[..., deep], wet[..., deep]) > 0.97
    assert _correlation(dry[..., deep], wet[..., deep]) < 0.8


def test_noise_is_as_loud_as_asked_and_silent_outside_the_band() -> None:
    flat = ReceiverConfig(gain_limit=1.0, counts_per_field=7e5)  # one gain for all samples
    drive = simulate_drive(EMPTY, PLAN, replace(SPOTLESS, noise_field=3e-4), 3, receiver=flat)
    noise = render_drive(drive)[..., 150:].astype(np.float64) - 128  # after the last of coupling and surface
    counts = 3e-4 * time_gain(RadarConfig(), flat)[150:]
    np.testing.assert_allclose(np.sqrt(np.mean(noise**2, axis=(0, 1))), counts, rtol=0.05)
    power = np.mean(np.abs(np.fft.rfft(noise * np.hanning(219), 512)) ** 2, axis=(0, 1))
    frequency_mhz = np.fft.rfftfreq(512, 0.16e-3)
    outside = (frequency_mhz < 85) | (frequency_mhz > 415)
    assert power[outside].sum() < 2e-3 * power.sum()
    other = render_drive(drive._replace(seed=4))[..., 150:].astype(np.float64) - 128
    assert abs(np.mean(noise * other)) < 0.01 * np.mean(noise**2)  # a second drive of the day has its own
    neighbours = noise[1:] * noise[:-1]
    assert abs(neighbours.mean()) < 0.01 * np.mean(noise**2)  # each scan has its own noise


def test_the_time_gain_undoes_the_loss_of_depth() -> None:
    gain = time_gain(RadarConfig(), ReceiverConfig())
    range_m = 1.2
    at = (2 * 0.3 / 0.299792458 + 2 * range_m / 0.1 + 4.0) / 0.16
    loss = np.exp(-1.4 * range_m) / (0.3 + range_m) ** 2
    assert np.interp(at, np.arange(369), gain) * loss == pytest.approx(900.0, rel=1e-3)
    assert np.all(np.diff(gain) >= 0)
    assert gain.max() == pytest.approx(1000.0 * gain[0])


def test_what_is_buried_survives_eight_bits_and_the_surface_does_not_clip_much() -> None:
    scans = render_drive(simulate_drive(GROUND, PLAN, Day(), 3))
    moving = scans.astype(np.float64) - scans.mean(axis=0)
    assert 6.0 < moving[..., 80:300].std() < 40.0
    assert np.mean((scans == 0) | (scans == 255)) < 0.01


def test_the_surface_is_constant_along_a_drive_unless_it_follows_the_height() -> None:
    fixed = render_drive(simulate_drive(EMPTY, PLAN, SPOTLESS, 3))
    moving = render_drive(simulate_drive(EMPTY, PLAN, SPOTLESS, 3, radar=RadarConfig(surface_follows_height=True)))
    assert np.ptp(fixed, axis=0).max() == 0
    assert np.ptp(fixed[0].astype(np.int32), axis=-1).min() > 100
    assert np.ptp(moving, axis=0).max() > 5


def test_a_day_adds_its_own_clutter_near_the_surface_only() -> None:
    bare, littered = (simulate_drive(GROUND, PLAN, replace(SPOTLESS, clutter_per_m2=c), 3).ground for c in (0.0, 5.0))
    assert bare is GROUND
    assert len(littered.stone_m) == len(GROUND.stone_m) + round(54.0 * 8.0 * 5.0)
    added = set(map(tuple, littered.stone_m)) - set(map(tuple, GROUND.stone_m))
    assert max(depth for _, _, depth in added) <= 0.5
    assert np.all(np.diff(littered.stone_m[:, 0]) >= 0)


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        (DrivePlan(0.0, 50.0), "along the road"),
        (DrivePlan(-20.0, 5.0), "along the road"),
        (DrivePlan(0.0, 10.0, lane_m=2.0), "to the side"),
    ],
)
def test_a_drive_beyond_the_corridor_is_refused(plan: DrivePlan, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        simulate_drive(GROUND, plan, Day(), 1)


def test_a_chunk_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="chunk_scans"):
        next(iterate_traces(simulate_drive(GROUND, PLAN, Day(), 1), 0))


def _uniform(response: Response) -> Response:
    """The same errors on every channel, so that a mirrored array is the same array."""
    return Response(*(np.broadcast_to(a[:1], a.shape).copy() for a in response))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))
