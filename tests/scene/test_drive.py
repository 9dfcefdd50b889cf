"""A recorded drive: the same from its seeds, in any chunks, from one program, seen from both ends."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar.array import uniform_array
from lgprjax.scene import (
    NO_FAULTS,
    Day,
    DrivePlan,
    ReceiverFaults,
    Response,
    iterate_traces,
    record_scans,
    render_drive,
    simulate_drive,
)
from scene.bare_ground import SPOTLESS
from scene.short_drives import EMPTY, GROUND, PLAN, drive_over, recorded

CLEAR = Day(seed=2, clutter_per_m2=1.0)
FAULTY = ReceiverFaults(dropped_share=0.05, clipped_share=0.05, interference_share=0.05, dead_channels=(0,))


def test_the_same_seeds_record_the_same_bytes() -> None:
    first, again = (render_drive(drive_over(GROUND, CLEAR, plan=PLAN, faults=FAULTY)) for _ in range(2))
    other_day = render_drive(drive_over(GROUND, replace(CLEAR, seed=3), plan=PLAN, faults=FAULTY))
    other_drive = render_drive(drive_over(GROUND, CLEAR, 4, plan=PLAN, faults=FAULTY))
    assert first.dtype == np.uint8
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other_day)
    assert not np.array_equal(first, other_drive)


@pytest.mark.parametrize("chunk_scans", [1, 50])
def test_chunks_never_change_the_bytes(chunk_scans: int) -> None:
    drive = drive_over(GROUND, CLEAR, plan=PLAN, faults=FAULTY)
    chunks = list(iterate_traces(drive, chunk_scans))
    assert all(len(chunk) == chunk_scans for chunk in chunks[:-1])
    assert 0 < len(chunks[-1]) <= chunk_scans
    np.testing.assert_array_equal(np.concatenate(chunks), render_drive(drive))
    assert len(drive.scan_time_s) == sum(len(chunk) for chunk in chunks)


def test_one_compiled_program_serves_a_drive_and_the_next() -> None:
    compiled = record_scans._cache_size  # type: ignore[attr-defined]
    render_drive(drive_over(GROUND, CLEAR, plan=PLAN))
    before = compiled()
    render_drive(drive_over(GROUND, replace(CLEAR, seed=5), 6, plan=replace(PLAN, stop_m=3.0)))
    assert compiled() == before


def test_the_way_back_sees_the_same_ground_mirrored() -> None:
    array = uniform_array(3, 0.2, height_m=0.3)  # above the rear axle, all channels at once
    still = replace(PLAN, wander_m=0.0, scan_rate_hz=100.0, speed_mps=5.0)  # a scan every 5 cm, at both ends too
    there, back = (
        simulate_drive(GROUND, replace(still, direction=d), SPOTLESS, 4, array=array, faults=NO_FAULTS) for d in (1, -1)
    )
    np.testing.assert_allclose(back.antenna_m[::-1, ::-1], there.antenna_m, atol=1e-9)
    outward, homeward = (recorded(drive._replace(response=_uniform(drive.response))) for drive in (there, back))
    assert np.abs(homeward[::-1, ::-1] - outward).max() <= 1
    assert np.mean(homeward[::-1, ::-1] == outward) > 0.99


def test_velocity_moves_deep_echoes_later_and_leaves_the_surface() -> None:
    dry, wet = (recorded(drive_over(GROUND, replace(SPOTLESS, velocity_factor=factor))) for factor in (1.0, 0.97))
    np.testing.assert_allclose(wet[..., 20:40].mean(axis=0), dry[..., 20:40].mean(axis=0), atol=4.0)
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


@pytest.mark.parametrize(
    ("plan", "value"),
    [(DrivePlan(0.0, 30.0), "22.0"), (DrivePlan(-20.0, 5.0), "-12.0"), (DrivePlan(0.0, 10.0, lane_m=2.0), "4.00")],
)
def test_a_drive_beyond_the_corridor_is_refused(plan: DrivePlan, value: str) -> None:
    with pytest.raises(ValueError, match=value):
        drive_over(GROUND, Day(), plan=plan)


def test_a_chunk_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="chunk_scans"):
        next(iterate_traces(drive_over(EMPTY), 0))


def _uniform(response: Response) -> Response:
    """The same errors on every channel, so that a mirrored array is the same array."""
    return Response(*(np.broadcast_to(a[:1], a.shape).copy() for a in response))


def _correlation(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))
