"""The drive-by-wire box against data_schema/wire.toml, by frames made by hand."""

import struct

import pytest

from lgprjax.simulation.devices.boxes import DeviceSender, DriveBox, Measured
from simulation.devices.host_frames import MS, Status, drive_command, host_frame, read_frame, read_status

_SEEN = Measured(2.43, 1234, 24.0, 0.5, True, 0.3, 0.1, 12.5, 1.5)


class _Bench:
    """A box with a host that counts and keeps time."""

    def __init__(self) -> None:
        self.box = DriveBox(DeviceSender(5, 1000))
        self.now_ns, self.sequence = 3_000 * MS, 0

    def wait(self, ms: int) -> None:
        self.now_ns += ms * MS

    def command(self, engage: int, **more: float) -> None:
        self.box.receive(drive_command(self.sequence, self.now_ns, engage, **more), self.now_ns)  # type: ignore[arg-type]
        self.sequence += 1

    def engage(self, bits: int = 3) -> None:
        for told in (0, bits):
            self.command(told)
            self.wait(20)

    def status(self) -> Status:
        return read_status(self.box.status(self.now_ns, _SEEN))

    def rolls(self, speed_mps: float, pressure: float = 0.0) -> None:
        self.box.sense(self.now_ns, speed_mps, pressure, 24.0)


@pytest.fixture
def bench() -> _Bench:
    return _Bench()


def test_its_status_says_what_it_measures(bench: _Bench) -> None:
    bench.command(0, mode=4)
    frame = read_frame(bench.box.status(bench.now_ns, _SEEN))
    assert (frame.mode, frame.session, frame.stamp_us) == (4, 5, bench.now_ns // 1000 + 1000)
    told = read_status(bench.box.status(bench.now_ns, _SEEN))
    assert told.potentiometer_v == pytest.approx(2.43)
    assert (told.encoder_counts, told.pedals) == (1234, 1)
    assert (told.odometer_m, told.speed_mps, told.refused) == (12.5, 1.5, 0)


def test_it_obeys_once_nothing_was_engaged(bench: _Bench) -> None:
    bench.command(3)
    assert not bench.box.orders(bench.now_ns).steering
    assert bench.status().state & 1
    bench.wait(20)
    bench.engage()
    orders = bench.box.orders(bench.now_ns)
    assert (orders.steering, orders.pedals) == (True, True)
    assert orders.front_rad == pytest.approx(0.1)
    assert orders.throttle == pytest.approx(0.2)
    assert bench.status().engaged == 3
    assert not bench.status().state & 1
    assert bench.status().command_sequence == 2


def test_a_silent_line_ends_it_after_the_time_to_live_and_brakes_a_rolling_vehicle(bench: _Bench) -> None:
    bench.engage()
    bench.rolls(2.0)
    bench.wait(179)
    assert bench.box.orders(bench.now_ns).steering
    bench.wait(3)
    orders = bench.box.orders(bench.now_ns)
    assert not orders.steering
    assert (orders.throttle, orders.brake) == (0.0, 0.5)
    assert (bench.status().engaged, bench.status().state & 1) == (0, 1)
    # It leaves the default only over a command that engages nothing.
    bench.command(3)
    assert not bench.box.orders(bench.now_ns).steering
    bench.wait(20)
    bench.engage()
    assert bench.box.orders(bench.now_ns).steering


@pytest.mark.parametrize(("bits", "speed"), [(1, 2.0), (3, 0.0)])
def test_without_pedals_or_standing_the_brake_stays_free(bench: _Bench, bits: int, speed: float) -> None:
    bench.engage(bits)
    bench.rolls(speed)
    bench.wait(500)
    assert bench.box.orders(bench.now_ns).brake == 0.0


def test_three_bad_frames_in_a_row_are_enough_and_two_are_not(bench: _Bench) -> None:
    bench.engage()
    for number in range(3):
        assert bench.box.orders(bench.now_ns).steering
        spoilt = bytearray(drive_command(bench.sequence, bench.now_ns, 3))
        spoilt[30] ^= 0x10
        bench.box.receive(bytes(spoilt), bench.now_ns)
        bench.wait(20)
        assert bench.status().refused == number + 1
    assert not bench.box.orders(bench.now_ns).steering
    assert bench.status().state & 3 == 3
    bench.command(0)
    assert bench.status().state & 3 == 0


def test_frames_that_are_replayed_or_were_held_up_are_refused(bench: _Bench) -> None:
    bench.engage()
    bench.box.receive(drive_command(0, bench.now_ns, 0), bench.now_ns)
    assert bench.status().refused == 1
    late = drive_command(bench.sequence, bench.now_ns, 3)
    bench.wait(150)
    bench.command(3)
    bench.sequence += 1
    bench.wait(100)
    held_up = drive_command(bench.sequence + 5, bench.now_ns - 201 * MS, 0)
    bench.box.receive(held_up, bench.now_ns)
    assert bench.status().refused == 2
    # Its sequence number was passed meanwhile, too.
    bench.box.receive(late, bench.now_ns)
    assert (bench.status().engaged, bench.status().refused) == (3, 3)


def test_another_sender_is_refused_while_the_line_is_alive_and_taken_after(bench: _Bench) -> None:
    bench.engage()
    other = drive_command(0, bench.now_ns, 0, session=88)
    bench.box.receive(other, bench.now_ns)
    assert bench.status().engaged == 3
    assert bench.status().state & 4
    bench.wait(201)
    bench.box.receive(drive_command(1, bench.now_ns, 0, session=88, mode=1), bench.now_ns)
    assert bench.box.mode == 1
    # What was over does not come back, however silent the line.
    bench.wait(1500)
    bench.box.receive(drive_command(900, bench.now_ns, 0, mode=4), bench.now_ns)
    assert bench.box.mode == 1


def test_a_power_cut_brakes_until_nothing_is_asked_for(bench: _Bench) -> None:
    bench.engage()
    bench.command(4)
    orders = bench.box.orders(bench.now_ns)
    assert (orders.steering, orders.throttle, orders.brake, orders.cut) == (False, 0.0, 0.5, True)
    assert bench.status().engaged == 4
    bench.wait(20)
    bench.command(3)
    assert bench.box.orders(bench.now_ns).brake == 0.5
    bench.wait(20)
    bench.engage()
    assert bench.box.orders(bench.now_ns).brake == 0.0


@pytest.mark.parametrize(("pressure", "state"), [(0.48, 128), (0.0, 32)])
def test_the_braking_test_presses_and_measures(bench: _Bench, pressure: float, state: int) -> None:
    bench.command(0)
    bench.rolls(0.0)
    bench.box.receive(host_frame(0x22, b"\x01", bench.sequence, bench.now_ns), bench.now_ns)
    bench.sequence += 1
    assert bench.box.orders(bench.now_ns).brake == 0.5
    for _ in range(51):
        bench.wait(20)
        bench.command(0)
        bench.rolls(0.0, pressure)
    assert bench.box.orders(bench.now_ns).brake == 0.0
    assert bench.status().state & (128 | 32) == state


def test_a_braking_test_goes_on_when_asked_for_again_and_not_while_it_rolls(bench: _Bench) -> None:
    bench.command(0)
    bench.rolls(1.0)
    bench.box.receive(host_frame(0x22, b"\x01", bench.sequence, bench.now_ns), bench.now_ns)
    bench.sequence += 1
    assert bench.box.orders(bench.now_ns).brake == 0.0
    bench.rolls(0.0)
    for _ in range(50):
        bench.box.receive(host_frame(0x22, b"\x01", bench.sequence, bench.now_ns), bench.now_ns)
        bench.sequence += 1
        bench.wait(20)
        bench.command(0)
        bench.rolls(0.0, 0.48)
    assert bench.status().state & (128 | 32) == 128


def test_off_the_bus_nothing_is_obeyed(bench: _Bench) -> None:
    bench.engage()
    bench.box.bus_off = True
    bench.command(3)
    assert not bench.box.orders(bench.now_ns).steering
    assert bench.status().state & 64


def test_frames_are_found_in_any_pieces_among_noise(bench: _Bench) -> None:
    stream = b"\x00\xa5\xa5\x5a\x07noise" + drive_command(0, bench.now_ns, 0) + b"\xa5"
    stream += drive_command(1, bench.now_ns, 3)
    for byte in struct.iter_unpack("c", stream):
        bench.box.receive(byte[0], bench.now_ns)
    assert bench.status().engaged == 3
    assert bench.status().command_sequence == 1
