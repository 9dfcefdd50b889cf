"""Faults of the devices: each shows on the lines, or in the truth, as it is meant to."""

import io
import math
import struct
from collections.abc import Callable
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
def world() -> CourseWorld:
    return make_world()


@pytest.fixture(scope="module")
def sound(world: CourseWorld) -> StageHost:
    """Driven as ``_SHOWS`` are, with nothing of theirs wrong."""
    return _engaged(world, {"kind": "ins_off"}, 1.2, throttle=0.9, front_rad=0.05)


@pytest.fixture(scope="module")
def standing(world: CourseWorld) -> StageHost:
    """Nothing is wrong but the radar, which does not scan."""
    return _stand(world, {"kind": "radar_missing"})


def _engaged(world: CourseWorld, fault: dict[str, Any], seconds: float, **command: float) -> StageHost:
    """Driven by commands from the start, with a fault from ``_FROM_S`` on."""
    host = StageHost(world, [], [{"at_s": _FROM_S, **fault}])
    host.run(0.1)
    host.engage(**command)
    host.run(seconds)
    return host


_SHOWS: dict[str, tuple[dict[str, Any], Callable[[StageHost], bool]]] = {
    "open": ({"kind": "potentiometer_open"}, lambda host: host.statuses()[-1].potentiometer_v == 5.5),
    "short": ({"kind": "potentiometer_short"}, lambda host: host.statuses()[-1].potentiometer_v == 0.0),
    "stuck": (
        {"kind": "potentiometer_stuck"},
        lambda host: len({status.potentiometer_v for status in host.statuses()[-40:]}) == 1,
    ),
    "encoder": (
        {"kind": "encoder_offset", "counts": 5000},
        lambda host: max(np.diff([status.encoder_counts for status in host.statuses()])) > 4900,
    ),
    "odometer dead": (
        {"kind": "odometer_dead"},
        lambda host: host.statuses()[-1].speed_mps == 0.0 and host.truth()["speed_mps"][-1] > 0.5,
    ),
    "odometer reversed": ({"kind": "odometer_reversed"}, lambda host: host.statuses()[-1].speed_mps < -0.5),
    "odometer slips": (
        {"kind": "odometer_slip", "share": 0.5},
        lambda host: host.statuses()[-1].speed_mps > 1.35 * host.truth()["speed_mps"][-1],
    ),
    "supply": ({"kind": "servo_weak", "supply_v": 12.0}, lambda host: abs(host.statuses()[-1].supply_v - 12.0) < 0.2),
    "sag": (
        {"kind": "supply_sag", "v": 9.0},
        lambda host: 3 <= sum(status.supply_v < 15.0 for status in host.statuses()) <= 8,
    ),
    "bus": ({"kind": "bus_off"}, lambda host: host.statuses()[-1].state & 64 > 0 and host.statuses()[-1].engaged == 0),
    "second master": (
        {"kind": "second_master"},
        lambda host: host.statuses()[-1].state & 4 > 0 and host.truth()["command_front_rad"].max() < 0.34,
    ),
    "silent": ({"kind": "line_silent", "line": "drive_by_wire"}, lambda host: 40 <= len(host.statuses()) <= 55),
    "override stuck": ({"kind": "override_stuck"}, lambda host: _buttons(host) & 3 == 1),
    "override cut": ({"kind": "override_wire_cut"}, lambda host: _buttons(host) & 3 == 0),
    "estop": ({"kind": "estop_held"}, lambda host: _buttons(host) & 4 == 4),
    "throttle": (
        {"kind": "throttle_stuck", "at": 0.8},
        lambda host: host.truth()["throttle"][-1] == 0.8 and abs(host.statuses()[-1].throttle - 0.8) < 0.02,
    ),
}


def _buttons(host: StageHost) -> int:
    return int(struct.unpack("<H", host.frames("controller", 0x30)[-1].payload)[0])


@pytest.mark.parametrize("name", _SHOWS)
def test_it_shows(world: CourseWorld, sound: StageHost, name: str) -> None:
    fault, shows = _SHOWS[name]
    assert shows(_engaged(world, fault, 1.2, throttle=0.9, front_rad=0.05))
    assert not shows(sound)


@pytest.mark.parametrize(
    ("fault", "least", "most"),
    [
        ({"kind": "gnss_off"}, 0.19, 0.21),
        ({"kind": "servo_stalled"}, -0.01, 0.12),
        ({"kind": "servo_runaway", "radps": 0.4}, 0.4, 0.53),
    ],
)
def test_where_the_wheels_go(world: CourseWorld, fault: dict[str, Any], least: float, most: float) -> None:
    host = StageHost(world, [], [{"at_s": _FROM_S, **fault}])
    host.run(0.1)
    host.engage(front_rad=0.0)
    host.run(_FROM_S)
    host.command = {"engage": 3, "front_rad": 0.2}
    host.run(1.5)
    assert least <= host.truth()["front_rad"][-1] <= most


def test_stuck_rear_wheels_turn_the_vehicle_less(world: CourseWorld) -> None:
    turned = {}
    for name, fault in (("sound", {"kind": "gnss_off"}), ("stuck", {"kind": "rear_stuck", "rad": 0.0})):
        host = _engaged(world, fault, 2.5, throttle=0.8, front_rad=0.2)
        truth = host.truth()
        way = np.hypot(np.diff(truth["x_m"]), np.diff(truth["y_m"]))[-20:].sum()
        turned[name] = (truth["yaw_rad"][-1] - truth["yaw_rad"][-21]) / way
    # tan of the front angle alone over the wheelbase, less what the ruts add.
    assert turned["stuck"] == pytest.approx(math.tan(0.2) / 3.8, abs=0.008)
    assert turned["sound"] == pytest.approx((math.tan(0.2) + math.tan(0.126)) / 3.8, abs=0.008)


def test_a_dead_brake_has_no_pressure(world: CourseWorld) -> None:
    host = _engaged(world, {"kind": "brake_dead"}, 1.5, brake=0.6)
    assert host.truth()["brake"][-1] == 0.0
    assert host.statuses()[-1].brake < 0.05
    assert max(status.brake for status in host.statuses()) > 0.25


def test_a_damaged_line_is_refused_and_ends_in_the_defaults(world: CourseWorld) -> None:
    host = _engaged(world, {"kind": "line_corrupt", "line": "drive_by_wire"}, 0.8, throttle=0.5)
    # Three frames of 1/42 s, and the one that came before them.
    engaged = host.truth()["engaged"]
    assert engaged[int(0.9 * _FROM_S * 42)] == 3
    assert engaged[-1] == 0
    assert np.flatnonzero(engaged == 3)[-1] <= int((_FROM_S + 0.1 + 0.1) * 42)
    with pytest.raises(AssertionError):
        read_frame(host.told["drive_by_wire"][-1])


def test_a_counter_that_repeats_is_seen_on_both_ways(world: CourseWorld) -> None:
    host = _engaged(world, {"kind": "line_repeat", "line": "drive_by_wire"}, 0.8, throttle=0.5)
    frames = host.frames("drive_by_wire", 0x21)
    assert frames[-1].sequence == frames[-2].sequence
    assert host.truth()["engaged"][-1] == 0


def _navigation(host: StageHost, identity: str) -> list[Any]:
    read = UBXReader(io.BytesIO(b"".join(host.told["gnss"])))
    return [message for _, message in read if message.identity == identity]


def _itow(message: Any) -> int:
    return int(struct.unpack_from("<I", message.serialize(), 6)[0])


def _stand(world: CourseWorld, fault: dict[str, Any], seconds: float = 1.5) -> StageHost:
    host = StageHost(world, [], [{"at_s": _FROM_S, **fault}])
    host.run(seconds)
    return host


def test_gnss_off_and_stuck(world: CourseWorld) -> None:
    assert 2 <= len(_navigation(_stand(world, {"kind": "gnss_off"}), "NAV-PVT")) <= 3
    fixes = _navigation(_stand(world, {"kind": "gnss_stuck"}), "NAV-PVT")
    assert len({(fix.lat, fix.lon) for fix in fixes[-5:]}) == 1
    assert len({_itow(fix) for fix in fixes[-5:]}) == 5


def test_gnss_jumps_by_what_is_told(world: CourseWorld, standing: StageHost) -> None:
    jumped = _navigation(_stand(world, {"kind": "gnss_jump", "m": [0.0, 30.0]}), "NAV-PVT")
    sound = _navigation(standing, "NAV-PVT")
    # A degree of latitude at 42 degrees is 111.07 km.
    assert (jumped[-1].lat - sound[-1].lat) * 111_070.0 == pytest.approx(30.0, abs=0.1)
    assert jumped[1].lat == sound[1].lat


@pytest.mark.parametrize(("kind", "solution", "least_m"), [("gnss_float", 1, 0.2), ("gnss_single", 0, 1.0)])
def test_a_poorer_solution_says_so(world: CourseWorld, kind: str, solution: int, least_m: float) -> None:
    fix = _navigation(_stand(world, {"kind": kind}), "NAV-PVT")[-1]
    assert fix.carrSoln == solution
    assert fix.hAcc >= 1000 * least_m


def test_time_steps_and_weeks_roll_over(world: CourseWorld) -> None:
    steps = np.diff(
        [_itow(message) for message in _navigation(_stand(world, {"kind": "time_step", "s": -2.0}), "NAV-ATT")]
    )
    assert sorted({int(step) for step in steps}) == [-1980, 20]
    rolled = [_itow(message) for message in _navigation(_stand(world, {"kind": "week_rollover"}), "NAV-ATT")]
    assert rolled[0] == 604_800_000 - round(1000 * _FROM_S)
    assert 0 in rolled


def test_what_the_ins_says(world: CourseWorld, standing: StageHost) -> None:
    sound = _navigation(standing, "NAV-ATT")[-1].heading
    reversed_ = _navigation(_stand(world, {"kind": "heading_reversed"}), "NAV-ATT")[-1].heading
    assert abs(sound - reversed_) == pytest.approx(180.0, abs=1.0)
    biased = _stand(world, {"kind": "ins_bias", "rad": 0.1, "radps": 0.2})
    # Yaw to the left is a smaller compass heading.
    assert sound - _navigation(biased, "NAV-ATT")[-1].heading == pytest.approx(math.degrees(0.1), abs=0.5)
    assert _navigation(biased, "ESF-INS")[-1].zAngRate == pytest.approx(-math.degrees(0.2), abs=0.6)
    assert _navigation(_stand(world, {"kind": "ins_nan"}), "ESF-INS")[-1].zAngRateValid == 0
    stuck = _navigation(_stand(world, {"kind": "ins_stuck"}), "NAV-ATT")
    assert len({message.heading for message in stuck[-50:]}) == 1
    assert 18 <= len(_navigation(_stand(world, {"kind": "ins_off"}), "NAV-ATT")) <= 22


def _scan(world: CourseWorld, *faults: dict[str, Any]) -> StageHost:
    host = StageHost(world, [], list(faults))
    host.start_radar()
    host.run(0.4)
    return host


def _data(host: StageHost, which: int) -> np.ndarray:
    payload = host.frames("radar", 0x12)[which].payload
    return np.frombuffer(payload[12:], np.uint8).astype(np.float64)


def test_what_the_radar_sends(world: CourseWorld) -> None:
    # All of the standing vehicle: the ground below is the same but for noise.
    sound = _scan(world)
    again = np.corrcoef(_data(sound, -1), _data(sound, -2))[0, 1]
    assert again > 0.96
    wrong = [
        _scan(world, {"at_s": 0.1, "kind": "radar_wrong_place", "m": [3.0, 0.0]}),
        _scan(world, {"at_s": 0.1, "kind": "radar_faded", "share": 0.2}),
        _scan(world, {"at_s": 0.1, "kind": "radar_garbage"}),
    ]
    elsewhere, faded, garbage = (np.corrcoef(_data(sound, -1), _data(other, -1))[0, 1] for other in wrong)
    assert 0.2 < elsewhere < again - 0.02
    assert faded == pytest.approx(0.2, abs=0.06)
    assert abs(garbage) < 0.06
    # Before its fault each heard the same.
    assert all(np.array_equal(_data(sound, 0), _data(other, 0)) for other in wrong)


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


def test_missing_and_late_scans(world: CourseWorld) -> None:
    count = len(_scan(world).frames("radar", 0x12))
    missing = _scan(world, {"at_s": 0.2, "kind": "radar_missing"})
    assert len(missing.frames("radar", 0x12)) == pytest.approx(0.55 * count, abs=4)
    slow = _scan(world, {"at_s": 0.0, "kind": "radar_slow", "s": 0.2})
    assert len(slow.frames("radar", 0x12)) == pytest.approx(0.5 * count, abs=4)
    assert missing.frames("radar", 0x13)[-1].payload[0] == 1
