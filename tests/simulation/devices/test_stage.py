"""The devices and their world together, in simulated time."""

import io
import itertools
import struct

import numpy as np
import pytest
from pyubx2 import UBXReader

from lgprjax.scene import WEATHER, LiveRadar, draw_springs
from lgprjax.simulation.devices.world import CourseWorld
from refusals import refused
from simulation.devices.stage_host import BEGIN_NS, COURSE, DRIVE_SEED, FRAME, StageHost

_UNSEEN_S = 4.0
_DRIVES = [{"at_s": 0.0, "do": "drive", "speed_mps": 3.0}]


@pytest.fixture(scope="module")
def driven(world: CourseWorld) -> StageHost:
    """By its driver, the last half second scanned."""
    host = StageHost(world, _DRIVES, [])
    host.run(_UNSEEN_S)
    host.start_radar()
    host.run(0.5)
    return host


def _positions(host: StageHost) -> np.ndarray:
    """Antenna in the map's frame as NAV-PVT has it: time of week (s), east, north."""
    read = [message for _, message in UBXReader(io.BytesIO(b"".join(host.told["gnss"])))]
    fixes = [message for message in read if message.identity == "NAV-PVT"]
    latitude, longitude, height = (
        np.array(part) for part in zip(*((fix.lat, fix.lon, fix.height / 1e3) for fix in fixes), strict=True)
    )
    east, north, _ = FRAME.to_local(latitude, longitude, height)
    return np.stack([east, north], axis=1)


def test_rates_and_even_stamps(driven: StageHost) -> None:
    for line, kind, step_us in (
        ("drive_by_wire", 0x21, 10_000),
        ("controller", 0x30, 20_000),
        ("radar", 0x13, 100_000),
    ):
        frames = driven.frames(line, kind)
        assert {b.stamp_us - a.stamp_us for a, b in itertools.pairwise(frames)} == {step_us}
    scans = driven.frames("radar", 0x12)
    assert 56 <= len(scans) <= 63
    stamps = np.array([scan.stamp_us for scan in scans])
    numbers = np.array([struct.unpack_from("<I", scan.payload)[0] for scan in scans])
    assert np.abs(stamps - stamps[0] - (numbers - numbers[0]) * 1e6 / 126.0).max() <= 1.0
    read = [message.identity for _, message in UBXReader(io.BytesIO(b"".join(driven.told["gnss"])))]
    assert abs(read.count("NAV-ATT") - 225) <= 2
    assert abs(read.count("NAV-PVT") - 31) <= 2


def test_the_driver_holds_the_baseline(driven: StageHost) -> None:
    truth = driven.truth()
    assert np.abs(truth["cross_m"]).max() < 0.15
    assert truth["speed_mps"][-1] == pytest.approx(3.0, abs=0.4)
    assert np.all(np.diff(truth["mono_ns"]) > 0)
    assert truth["mono_ns"][0] > BEGIN_NS
    np.testing.assert_allclose(truth["rear_rad"], -0.63 * truth["front_rad"])


def test_gnss_has_the_antenna_ahead_of_the_axle(driven: StageHost) -> None:
    truth = driven.truth()
    told = _positions(driven)
    # A position each sixth tick, 30 ms old when it leaves.
    ticks = 6 * np.arange(1, len(told) + 1) - 1
    yaw = truth["yaw_rad"][ticks]
    antenna = np.stack([truth["x_m"][ticks] + np.cos(yaw), truth["y_m"][ticks] + np.sin(yaw)], axis=1)
    wrong = told - antenna
    assert np.hypot(*wrong.T).max() < 1.5
    # What is wrong wanders slowly: from fix to fix it hardly changes.
    assert np.abs(np.diff(wrong, axis=0)).max() < 0.25


def test_scans_are_rendered_where_the_vehicle_was(driven: StageHost, world: CourseWorld) -> None:
    truth, laid = driven.truth(), world.laid
    frame = driven.frames("radar", 0x12)[40]
    number = struct.unpack_from("<I", frame.payload)[0]
    begins_us = driven.frames("radar", 0x12)[0].stamp_us - 1_000_000 * _UNSEEN_S
    after_s = 1e-6 * (frame.stamp_us - begins_us)
    block = round(after_s * 126.0) // 3
    first = block * 3
    rows = np.stack([truth["x_m"], truth["y_m"], truth["yaw_rad"]], axis=1)
    before, after = rows[block - 1], rows[block]
    share = (np.arange(3)[:, None] + np.arange(11)[None] / 11.0) / 3.0
    place = before + share[..., None] * (after - before)
    radar = LiveRadar(
        laid.ground,
        WEATHER["clear"](7919 * COURSE.seed + DRIVE_SEED),
        laid.road,
        laid.array,
        draw_springs(laid.plan, DRIVE_SEED),
        scans=126 * 1200,
        seed=DRIVE_SEED,
    )
    scene = np.concatenate([world.frame.to_scene(place[..., :2]), place[..., 2:] + world.frame.turn_rad], axis=-1)
    wanted = radar.record(first, scene, float(truth["x_m"][block])).recorded[(number + round(_UNSEEN_S * 126)) % 3]
    found = np.frombuffer(frame.payload[12:], np.uint8).reshape(11, 369)
    assert np.mean(np.abs(found.astype(int) - wanted.astype(int)) <= 1) > 0.999


def test_the_command_steers_and_drives_once_engaged(world: CourseWorld) -> None:
    host = StageHost(world, [], [])
    host.run(0.2)
    host.engage(front_rad=0.2, throttle=0.4)
    host.run(3.0)
    truth = host.truth()
    assert truth["front_rad"][-1] == pytest.approx(0.2, abs=0.01)
    assert truth["speed_mps"][-1] > 0.8
    last = host.statuses()[-1]
    assert (last.engaged, last.pedals) == (3, 0)
    assert last.potentiometer_v == pytest.approx(2.43 + 2.0 * 0.2, abs=0.03)
    assert last.speed_mps == pytest.approx(truth["speed_mps"][-1], abs=0.15)
    counts = last.encoder_counts - host.statuses()[0].encoder_counts
    # The wheels stood straight; half of the play, 0.0026 rad, lies between servo and wheels.
    assert counts == pytest.approx(12000 * truth["front_rad"][-1], abs=80)


def test_the_same_seed_is_the_same_world_and_a_vehicle_that_nobody_drives_stands(world: CourseWorld) -> None:
    pair = [StageHost(world, _DRIVES, []) for _ in range(2)]
    for host in pair:
        host.run(0.5)
    assert pair[0].told == pair[1].told
    standing = StageHost(world, [], [])
    standing.run(1.0)
    assert np.abs(standing.truth()["speed_mps"]).max() < 1e-3


def test_beside_the_course_the_radar_hears_nothing(world: CourseWorld) -> None:
    still = np.array([0.0, 400.0, 0.0])
    assert world.record(0, still, still, 10.0) == [None, None, None]


def test_a_button_that_there_is_not_is_refused(world: CourseWorld) -> None:
    with refused("script[1].button", "plus", "press", found="horn"):
        StageHost(world, [{"at_s": 0, "do": "press", "button": "horn"}], [])
