"""Tracks of runs that only record, against made-up drives: pauses, silences, odd phases, biased headings."""

import math
import uuid
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from jaxtyping import Float
from pyubx2 import GET, UBXMessage

from lgprjax.formats import VehicleFile, read_run
from lgprjax.frames import LocalFrame, along_cross
from lgprjax.recordings.recover import RecordedTracks
from lgprjax.run_records import Record, RecordKind, Source, pack
from lgprjax.run_segment import ORIGINS
from lgprjax.runtime.config import PortsTable, PortTable, RuntimeConfig, SensorsTable
from lgprjax.runtime.drive_log import recorded_tracks
from lgprjax.runtime.recorder import SegmentWriter, tell_run
from lgprjax.wire import MESSAGES, Sender

_FRAME = LocalFrame(42.0, -71.0, 10.0)
_SECONDS, _LEVER_M, _T0 = 60.0, 1.0, 10**12
_PORT = PortTable(url="/dev/null")
_CONFIG = RuntimeConfig(
    file=Path("x.run.toml"),
    name="record",
    mode="record",
    ports=PortsTable(drive_by_wire=_PORT, gnss=_PORT),
    sensors=SensorsTable(gnss_delay_s=0.03),
)
_VEHICLE = VehicleFile.model_validate(
    {"name": "kit", "steering_kind": "counter_steer", "navigation": {"gnss_x_m": _LEVER_M}}
)


class Truth(NamedTuple):
    """A drive of a minute, a row a millisecond: standing, then 2 m/s in bends to both sides."""

    x_m: Float[np.ndarray, " row"]
    y_m: Float[np.ndarray, " row"]
    yaw_rad: Float[np.ndarray, " row"]
    rate_radps: Float[np.ndarray, " row"]
    way_m: Float[np.ndarray, " row"]


def truth() -> Truth:
    time_s = np.arange(0.0, _SECONDS, 1e-3)
    speed = 2.0 * np.clip((time_s - 5.0) / 2.0, 0.0, 1.0)
    rate = np.where(time_s > 8.0, 0.3 * np.sin(0.5 * (time_s - 8.0)), 0.0)

    def summed(values: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
        return 1e-3 * np.concatenate([[0.0], np.cumsum(values[:-1])])

    yaw = 0.4 + summed(rate)
    return Truth(summed(speed * np.cos(yaw)), summed(speed * np.sin(yaw)), yaw, rate, summed(speed))


TRUTH = truth()


class Silent(NamedTuple):
    """From when to when something says nothing, s."""

    begin_s: float = math.inf
    end_s: float = math.inf

    def at(self, time_s: float) -> bool:
        return self.begin_s <= time_s < self.end_s


class Case(NamedTuple):
    """What is different from a receiver that says everything.

    Attributes:
        control, receiver, box: their silences.
        gyro_every, heading_at: ticks from one yaw rate to the next; of five ticks the one with a heading.
        heading_off_deg, heading_sigma_deg: how wrong headings are, and what the receiver says of them.
        ins: whether there are headings and yaw rates.
        wrong: the receiver says zeros in the first second, and another place for two fixes.
    """

    control: Silent = Silent()
    receiver: Silent = Silent()
    box: Silent = Silent()
    gyro_every: int = 1
    heading_at: int = 1
    heading_off_deg: float = 0.0
    heading_sigma_deg: float = 0.1
    ins: bool = True
    wrong: bool = False


def _messages(case: Case) -> Iterator[tuple[int, Source, bytes]]:
    """Arrival, line and bytes of every message."""
    noise, box = np.random.default_rng(1), Sender(7)
    status = {field.name: 0 for field in MESSAGES["drive_status"].numbers}
    for tick in range(round(50 * _SECONDS)):
        at_s, row, now_ns = 0.02 * tick, 20 * tick, _T0 + 20_000_000 * tick
        itow = round(1000 * (100.0 + at_s))
        if not case.box.at(at_s):
            numbers = {**status, "odometer_m": float(TRUTH.way_m[row])}
            frame = box.frame("drive_status", numbers, mode=0, mono_ns=now_ns)
            yield now_ns + 1_000_000, Source.DRIVE_BY_WIRE, frame
        if case.receiver.at(at_s):
            continue
        if case.ins and tick % case.gyro_every == 0:
            turn = -math.degrees(TRUTH.rate_radps[row])
            rate = UBXMessage("ESF", "ESF-INS", GET, iTOW=itow, zAngRateValid=1, zAngRate=turn)
            yield now_ns + 2_000_000, Source.GNSS, bytes(rate.serialize())
        if case.ins and tick % 5 == case.heading_at:
            heading = (90.0 - math.degrees(TRUTH.yaw_rad[row]) + case.heading_off_deg) % 360.0
            turned = UBXMessage("NAV", "NAV-ATT", GET, iTOW=itow, heading=heading, accHeading=case.heading_sigma_deg)
            yield now_ns + 3_000_000, Source.GNSS, bytes(turned.serialize())
        if tick % 5 == 0:
            yaw, (east, north) = TRUTH.yaw_rad[row], 0.005 * noise.standard_normal(2)
            east += TRUTH.x_m[row] + _LEVER_M * math.cos(yaw)
            north += TRUTH.y_m[row] + _LEVER_M * math.sin(yaw)
            latitude, longitude, _ = _FRAME.to_geodetic(np.array([east]), np.array([north]), np.zeros(1))
            place = {"lat": float(latitude[0]), "lon": float(longitude[0]), "height": 10_000, "hAcc": 14}
            place |= {"lat": 0.0, "lon": 0.0} if case.wrong and tick < 50 else {}
            place |= {"lon": -72.0} if case.wrong and tick in (1500, 1505) else {}
            fix = UBXMessage("NAV", "NAV-PVT", GET, iTOW=itow, fixType=3, gnssFixOk=1, carrSoln=2, **place)
            yield now_ns + 30_000_000, Source.GNSS, bytes(fix.serialize())


def recorded(folder: Path, case: Case) -> RecordedTracks:
    """The tracks of a run, written as its recorder does: each tick, then the messages that came before it."""
    config = folder / "x.run.toml"
    config.touch()
    run = uuid.uuid4().bytes
    tell_run(folder, run, config)
    writer, origin, position = SegmentWriter(folder, run, 0, 0, 1e9), ORIGINS.index("control_log"), count(1)

    def put(kind: RecordKind, source: Source, tick: int, mono_ns: int, payload: bytes) -> None:
        writer.append(origin, next(position), pack(Record(kind, source, tick, mono_ns, payload)))

    waiting = sorted(_messages(case), key=lambda message: message[0])
    for tick in range(1, round(50 * _SECONDS)):
        now_ns = _T0 + 20_000_000 * tick
        came = [message for message in waiting[:20] if message[0] <= now_ns]
        waiting = waiting[len(came) :]
        if case.control.at(0.02 * tick):
            continue
        put(RecordKind.TICK, Source.CONTROL, tick, now_ns, b"")
        for mono_ns, source, raw in came:
            put(RecordKind.PORT_IN, source, tick, mono_ns, raw)
    writer.close("ended")
    return recorded_tracks(read_run(folder), _CONFIG, _VEHICLE)


def errors_of(folder: Path, tracks: RecordedTracks) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times, s, and errors along, across (m) and of the heading (degrees)."""
    clock, track = read_run(folder).clock, tracks.navigation
    assert clock is not None
    time_s = track.time_s + (clock[1] - _T0) / 1e9
    east, north, _ = _FRAME.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    yaw = _FRAME.yaw_of_heading(track.heading_deg, track.longitude_deg)
    x, y, true = (np.interp(1000.0 * time_s, np.arange(len(TRUTH.x_m)), values) for values in TRUTH[:3])
    along, across = along_cross(east - x, north - y, true)
    return time_s, along, across, np.degrees((yaw - true + np.pi) % (2.0 * np.pi) - np.pi)


@pytest.mark.parametrize(
    ("case", "heading_deg", "covered_s"),
    [
        (Case(), 0.3, 59.5),
        (Case(heading_at=0), 0.3, 59.5),
        (Case(gyro_every=5), 1.5, 59.5),
        (Case(heading_off_deg=2.0, heading_sigma_deg=3.0), 0.6, 59.5),
        (Case(control=Silent(30.0, 33.0)), 0.6, 56.0),
        (Case(receiver=Silent(30.0, 34.0)), 0.6, 55.0),
        (Case(box=Silent(20.0)), 0.3, 59.5),
        (Case(ins=False), 2.0, 40.0),
        (Case(wrong=True), 0.3, 58.4),
    ],
    ids=[
        "sound",
        "phases",
        "slow gyro",
        "heading off",
        "control dead",
        "receiver restarts",
        "box dies",
        "no INS",
        "wrong places",
    ],
)
def test_poses_are_those_of_the_drive(tmp_path: Path, case: Case, heading_deg: float, covered_s: float) -> None:
    tracks = recorded(tmp_path, case)
    time_s, along, across, heading = errors_of(tmp_path, tracks)
    assert np.abs(along).max() < 0.15
    assert np.abs(across).max() < 0.15
    assert np.sqrt(np.mean(along**2)) < 0.025
    assert np.sqrt(np.mean(across**2)) < 0.025
    assert np.abs(heading).max() < heading_deg
    step_s = np.diff(time_s)
    assert step_s[step_s < 1.0].sum() > covered_s


def test_nothing_is_made_up_while_nobody_knows_the_turn(tmp_path: Path) -> None:
    for name, case in (("a", Case(control=Silent(30.0, 33.0))), ("b", Case(receiver=Silent(30.0, 34.0)))):
        (tmp_path / name).mkdir()
        time_s, *_ = errors_of(tmp_path / name, recorded(tmp_path / name, case))
        assert not np.any((time_s > 31.0) & (time_s < 32.9))
