"""Faults of the devices: each shows on the lines, or in the truth, as it is meant to."""

import io
import math
import struct
from typing import Any

import numpy as np
import pytest
from pyubx2 import UBXReader

from lgprjax.scene import SweepPlan
from lgprjax.simulation.devices.world import CourseWorld
from simulation.devices.host_frames import read_frame
from simulation.devices.stage_host import StageHost, make_world

_FROM_S = 0.4


@pytest.fixture(scope="module")
def sound(world: CourseWorld) -> StageHost:
    """Driven with nothing of the box wrong."""
    return _engaged(world, {"kind": "ins_off"}, seconds=1.2, throttle=0.9, front_rad=0.05)


@pytest.fixture(scope="module")
def standing(world: CourseWorld) -> StageHost:
    """Nothing is wrong but the radar, which does not scan."""
    return _stand(world, {"kind": "radar_missing"})


def _engaged(world: CourseWorld, *faults: dict[str, Any], seconds: float, **command: float) -> StageHost:
    """Driven by commands from the start, with faults from ``_FROM_S`` on."""
    host = StageHost(world, [], [{"at_s": _FROM_S, **fault} for fault in faults])
    host.run(0.1)
    host.engage(**command)
    host.run(seconds)
    return host


def _buttons(host: StageHost) -> int:
    return int(struct.unpack("<H", host.frames("controller", 0x30)[-1].payload)[0])


def test_faults_of_the_box_show(world: CourseWorld, sound: StageHost) -> None:
    """What does not touch each other is wrong in one drive."""

    def wrong(*faults: dict[str, Any]) -> StageHost:
        return _engaged(world, *faults, seconds=1.2, throttle=0.9, front_rad=0.05)

    host = wrong(
        {"kind": "potentiometer_open"},
        {"kind": "odometer_dead"},
        {"kind": "override_stuck"},
        {"kind": "throttle_stuck", "at": 0.8},
        {"kind": "servo_weak", "supply_v": 12.0},
    )
    last, truth = host.statuses()[-1], host.truth()
    assert last.potentiometer_v == 5.5
    assert last.speed_mps == 0.0
    assert truth["speed_mps"][-1] > 0.5
    assert _buttons(host) & 3 == 1
    assert truth["throttle"][-1] == 0.8
    assert last.throttle == pytest.approx(0.8, abs=0.02)
    assert last.supply_v == pytest.approx(12.0, abs=0.2)
    host = wrong(
        {"kind": "potentiometer_short"},
        {"kind": "odometer_reversed"},
        {"kind": "override_wire_cut"},
        {"kind": "supply_sag", "v": 9.0},
        {"kind": "encoder_offset", "counts": 5000},
    )
    statuses = host.statuses()
    assert statuses[-1].potentiometer_v == 0.0
    assert statuses[-1].speed_mps < -0.5
    assert _buttons(host) & 3 == 0
    assert 3 <= sum(status.supply_v < 15.0 for status in statuses) <= 8
    assert max(np.diff([status.encoder_counts for status in statuses])) > 4900
    host = wrong({"kind": "potentiometer_stuck"}, {"kind": "odometer_slip", "share": 0.5}, {"kind": "estop_held"})
    assert len({status.potentiometer_v for status in host.statuses()[-40:]}) == 1
    assert host.statuses()[-1].speed_mps > 1.35 * host.truth()["speed_mps"][-1]
    assert _buttons(host) & 4 == 4
    last = wrong({"kind": "bus_off"}).statuses()[-1]
    assert (last.state & 64, last.engaged) == (64, 0)
    host = wrong({"kind": "second_master"})
    assert host.statuses()[-1].state & 4
    assert host.truth()["command_front_rad"].max() < 0.34
    assert 40 <= len(wrong({"kind": "line_silent", "line": "drive_by_wire"}).statuses()) <= 55
    # With nothing of theirs wrong:
    statuses, truth = sound.statuses(), sound.truth()
    last = statuses[-1]
    assert len({status.potentiometer_v for status in statuses[-40:]}) > 1
    assert last.speed_mps == pytest.approx(truth["speed_mps"][-1], rel=0.2)
    assert (_buttons(sound) & 7, last.state & (64 | 4), last.engaged) == (2, 0, 3)
    assert truth["throttle"][-1] == pytest.approx(0.9)
    assert min(status.supply_v for status in statuses) > 15.0
    assert max(np.diff([status.encoder_counts for status in statuses])) < 4900
    assert len(statuses) > 100


def test_where_the_wheels_go(world: CourseWorld) -> None:
    cases: list[tuple[dict[str, Any], float, float]] = [
        ({"kind": "gnss_off"}, 0.19, 0.21),
        ({"kind": "servo_stalled"}, -0.01, 0.12),
        ({"kind": "servo_runaway", "radps": 0.4}, 0.4, 0.53),
    ]
    for fault, least, most in cases:
        host = _engaged(world, fault, seconds=_FROM_S, front_rad=0.0)
        host.command = {"engage": 3, "front_rad": 0.2}
        host.run(1.5)
        assert least <= host.truth()["front_rad"][-1] <= most, fault


def test_stuck_rear_wheels_turn_the_vehicle_less(world: CourseWorld) -> None:
    turned = {}
    faults: dict[str, dict[str, Any]] = {"sound": {"kind": "gnss_off"}, "stuck": {"kind": "rear_stuck", "rad": 0.0}}
    for name, fault in faults.items():
        host = _engaged(world, fault, seconds=2.5, throttle=0.8, front_rad=0.2)
        truth = host.truth()
        way = np.hypot(np.diff(truth["x_m"]), np.diff(truth["y_m"]))[-20:].sum()
        turned[name] = (truth["yaw_rad"][-1] - truth["yaw_rad"][-21]) / way
    # tan of the front angle alone over the wheelbase, less what the ruts add.
    assert turned["stuck"] == pytest.approx(math.tan(0.2) / 3.8, abs=0.008)
    assert turned["sound"] == pytest.approx((math.tan(0.2) + math.tan(0.126)) / 3.8, abs=0.008)


def test_a_dead_brake_and_a_line_that_is_damaged_or_repeats(world: CourseWorld) -> None:
    host = _engaged(world, {"kind": "brake_dead"}, seconds=1.5, brake=0.6)
    assert host.truth()["brake"][-1] == 0.0
    assert host.statuses()[-1].brake < 0.05
    assert max(status.brake for status in host.statuses()) > 0.25
    host = _engaged(world, {"kind": "line_corrupt", "line": "drive_by_wire"}, seconds=0.8, throttle=0.5)
    # Three frames of 1/42 s, and the one that came before them; then the defaults.
    engaged = host.truth()["engaged"]
    assert engaged[int(0.9 * _FROM_S * 42)] == 3
    assert engaged[-1] == 0
    assert np.flatnonzero(engaged == 3)[-1] <= int((_FROM_S + 0.1 + 0.1) * 42)
    with pytest.raises(AssertionError):
        read_frame(host.told["drive_by_wire"][-1])
    # A counter that repeats is seen on both ways.
    host = _engaged(world, {"kind": "line_repeat", "line": "drive_by_wire"}, seconds=0.8, throttle=0.5)
    frames = host.frames("drive_by_wire", 0x21)
    assert frames[-1].sequence == frames[-2].sequence
    assert host.truth()["engaged"][-1] == 0


def _navigation(host: StageHost, identity: str) -> list[Any]:
    read = UBXReader(io.BytesIO(b"".join(host.told["gnss"])))
    return [message for _, message in read if message.identity == identity]


def _itow(message: Any) -> int:
    return int(struct.unpack_from("<I", message.serialize(), 6)[0])


def _stand(world: CourseWorld, *faults: dict[str, Any]) -> StageHost:
    host = StageHost(world, [], [{"at_s": _FROM_S, **fault} for fault in faults])
    host.run(1.5)
    return host


def test_what_gnss_and_ins_say(world: CourseWorld, standing: StageHost) -> None:
    """Each fault of the receiver with one of the INS, which it leaves alone."""
    sound_fix, sound_deg = _navigation(standing, "NAV-PVT"), _navigation(standing, "NAV-ATT")[-1].heading
    host = _stand(world, {"kind": "gnss_off"}, {"kind": "heading_reversed"})
    assert 2 <= len(_navigation(host, "NAV-PVT")) <= 3
    assert abs(sound_deg - _navigation(host, "NAV-ATT")[-1].heading) == pytest.approx(180.0, abs=1.0)
    host = _stand(world, {"kind": "gnss_stuck"}, {"kind": "ins_bias", "rad": 0.1, "radps": 0.2})
    fixes = _navigation(host, "NAV-PVT")
    assert len({(fix.lat, fix.lon) for fix in fixes[-5:]}) == 1
    assert len({_itow(fix) for fix in fixes[-5:]}) == 5
    # Yaw to the left is a smaller compass heading.
    assert sound_deg - _navigation(host, "NAV-ATT")[-1].heading == pytest.approx(math.degrees(0.1), abs=0.5)
    assert _navigation(host, "ESF-INS")[-1].zAngRate == pytest.approx(-math.degrees(0.2), abs=0.6)
    host = _stand(world, {"kind": "gnss_jump", "m": [0.0, 30.0]}, {"kind": "ins_nan"})
    jumped = _navigation(host, "NAV-PVT")
    # A degree of latitude at 42 degrees is 111.07 km.
    assert (jumped[-1].lat - sound_fix[-1].lat) * 111_070.0 == pytest.approx(30.0, abs=0.1)
    assert jumped[1].lat == sound_fix[1].lat
    assert _navigation(host, "ESF-INS")[-1].zAngRateValid == 0
    host = _stand(world, {"kind": "gnss_float"}, {"kind": "ins_stuck"})
    fix = _navigation(host, "NAV-PVT")[-1]
    assert (fix.carrSoln, fix.hAcc >= 200) == (1, True)
    assert len({message.heading for message in _navigation(host, "NAV-ATT")[-50:]}) == 1
    host = _stand(world, {"kind": "gnss_single"}, {"kind": "ins_off"})
    fix = _navigation(host, "NAV-PVT")[-1]
    assert (fix.carrSoln, fix.hAcc >= 1000) == (0, True)
    assert 18 <= len(_navigation(host, "NAV-ATT")) <= 22


def test_time_steps_and_weeks_roll_over(world: CourseWorld) -> None:
    told = [_itow(message) for message in _navigation(_stand(world, {"kind": "time_step", "s": -2.0}), "NAV-ATT")]
    assert sorted({int(step) for step in np.diff(told)}) == [-1980, 20]
    rolled = [_itow(message) for message in _navigation(_stand(world, {"kind": "week_rollover"}), "NAV-ATT")]
    assert rolled[0] == 604_800_000 - round(1000 * _FROM_S)
    assert 0 in rolled


def _scan(world: CourseWorld, *faults: dict[str, Any]) -> StageHost:
    host = StageHost(world, [], list(faults))
    host.start_radar()
    host.run(0.4)
    return host


def _data(host: StageHost, which: int) -> np.ndarray:
    payload = host.frames("radar", 0x12)[which].payload
    return np.frombuffer(payload[12:], np.uint8).astype(np.float64)


@pytest.fixture(scope="module")
def scanned(world: CourseWorld) -> StageHost:
    """Scans of the standing vehicle, nothing wrong."""
    return _scan(world)


def test_what_the_radar_sends(world: CourseWorld, scanned: StageHost) -> None:
    # All of the standing vehicle: the ground below is the same but for noise.
    again = np.corrcoef(_data(scanned, -1), _data(scanned, -2))[0, 1]
    assert again > 0.96
    wrong = [
        _scan(world, {"at_s": 0.1, "kind": "radar_wrong_place", "m": [3.0, 0.0]}),
        _scan(world, {"at_s": 0.1, "kind": "radar_faded", "share": 0.2}),
        _scan(world, {"at_s": 0.1, "kind": "radar_garbage"}),
    ]
    elsewhere, faded, garbage = (np.corrcoef(_data(scanned, -1), _data(other, -1))[0, 1] for other in wrong)
    assert 0.2 < elsewhere < again - 0.02
    assert faded == pytest.approx(0.2, abs=0.06)
    assert abs(garbage) < 0.06
    # Before its fault each heard the same.
    assert all(np.array_equal(_data(scanned, 0), _data(other, 0)) for other in wrong)


def test_sweeps_fade_and_are_garbage_but_for_the_calibration_channel() -> None:
    """Sent and damaged as sweeps: what fades is the antennas' own, drift and calibration path stay."""
    swept = make_world(SweepPlan())

    def rows(*faults: dict[str, Any]) -> np.ndarray:
        payload = _scan(swept, *faults).frames("radar", 0x15)[-1].payload
        return np.frombuffer(payload[18:], "<i2").reshape(12, 61, 2).astype(np.float64)

    sound = rows()
    faded = rows({"at_s": 0.1, "kind": "radar_faded", "share": 0.2})
    garbage = rows({"at_s": 0.1, "kind": "radar_garbage"})

    def alike(one: np.ndarray, other: np.ndarray) -> float:
        return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])

    assert alike(sound[:-1], faded[:-1]) == pytest.approx(0.2, abs=0.1)
    np.testing.assert_array_equal(sound[-1], faded[-1])
    assert abs(alike(sound, garbage)) < 0.1


def test_missing_and_late_scans(world: CourseWorld, scanned: StageHost) -> None:
    count = len(scanned.frames("radar", 0x12))
    missing = _scan(world, {"at_s": 0.2, "kind": "radar_missing"})
    assert len(missing.frames("radar", 0x12)) == pytest.approx(0.55 * count, abs=4)
    assert missing.frames("radar", 0x13)[-1].payload[0] == 1
    slow = _scan(world, {"at_s": 0.0, "kind": "radar_slow", "s": 0.2})
    assert len(slow.frames("radar", 0x12)) == pytest.approx(0.5 * count, abs=4)
