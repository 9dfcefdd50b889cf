"""What a receiver states beside its positions: accuracies of a message of their own (GST), rolls, and headings."""

from functools import reduce
from operator import xor

import numpy as np
import pytest

from lgprjax.frames import LocalFrame
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.control.senses import GnssSenses, LocalPosition
from lgprjax.runtime.gnss import Quality

LEAST_M, LOOSE_M = 0.01, 2.0
SINGLE, FIXED, FLOAT = 1, 4, 5
"""Qualities of a GGA."""


class Receiver:
    """A receiver that says what it is told to, in seconds since its beginning; each message arrives at once."""

    def __init__(self) -> None:
        self.senses = GnssSenses(LocalFrame(48.0, 11.0, 0.0), SensorsTable(gnss_sigma_m=LEAST_M))

    def gga(self, at_s: float, quality: int) -> LocalPosition:
        """A position; as the control loop has it then."""
        self._say(at_s, f"GNGGA,{self._clock(at_s)},4800.0,N,01100.0,E,{quality},12,0.6,500.0,M,0.0,M,1.0,0000")
        return self.place

    def pashr(self, at_s: float, roll_deg: float, sigma_deg: float = 0.05) -> None:
        """A heading of 90 degrees with roll and its own accuracy."""
        self._say(at_s, f"PASHR,{self._clock(at_s)},90.0,T,{roll_deg:.2f},0.5,,0.01,0.01,{sigma_deg:.3f},2,1")

    def hdt(self, at_s: float) -> None:
        """The heading by itself."""
        self._say(at_s, "GPHDT,90.0,T")

    def gst(self, at_s: float, sigma_m: float, of_s: float | None = None) -> None:
        """An accuracy, of the same time or of another."""
        clock = self._clock(at_s if of_s is None else of_s)
        self._say(at_s, f"GNGST,{clock},1,1,1,0,{sigma_m:.3f},{sigma_m:.3f},1")

    @property
    def place(self) -> LocalPosition:
        """The newest position."""
        assert self.senses.place is not None
        return self.senses.place

    def _say(self, at_s: float, body: str) -> None:
        raw = f"${body}*{reduce(xor, body.encode(), 0):02X}".encode()
        self.senses.take(Record(RecordKind.PORT_IN, Source.GNSS, 0, 5_000_000_000 + round(1e9 * at_s), raw))

    @staticmethod
    def _clock(at_s: float) -> str:
        return f"1200{at_s:05.2f}"


def test_an_accuracy_is_of_its_own_position_whichever_comes_first() -> None:
    for first in ("gga", "gst"):
        receiver = Receiver()
        for second, sigma_m in enumerate((0.7, 0.3, 0.9)):
            if first == "gst":
                receiver.gst(second, sigma_m)
            receiver.gga(second, FLOAT)
            if first == "gga":
                receiver.gst(second, sigma_m)
            assert receiver.place.sigma_m == receiver.place.reported_m == pytest.approx(sigma_m)
            tick = receiver.senses.end_tick()
            assert tick.place == receiver.place


@pytest.mark.parametrize(("first", "lost"), [("gga", SINGLE), ("gst", FLOAT)])
def test_the_first_position_after_a_loss_of_the_fix_is_not_a_centimetre(first: str, lost: int) -> None:
    receiver = Receiver()
    for second in range(3):
        if first == "gst":
            receiver.gst(second, 0.012)
        place = receiver.gga(second, FIXED)
        if first == "gga":
            receiver.gst(second, 0.012)
    assert (place.quality, place.sigma_m) == (Quality.FIXED, LEAST_M)
    assert place.reported_m == pytest.approx(0.012)
    for second in range(3, 60):
        place = receiver.gga(second, lost)
        assert (place.sigma_m, place.reported_m) == (LOOSE_M, LOOSE_M)
    # Its own accuracy makes it as good as it is.
    receiver.gst(59, 1.2)
    assert receiver.place.sigma_m == pytest.approx(1.2)


def test_an_accuracy_holds_for_positions_of_its_quality_for_two_seconds() -> None:
    receiver = Receiver()
    receiver.gga(0.0, SINGLE)
    receiver.gst(0.0, 3.0)
    assert receiver.gga(1.0, SINGLE).sigma_m == pytest.approx(3.0)
    assert receiver.gga(1.9, SINGLE).sigma_m == pytest.approx(3.0)
    assert receiver.gga(2.0, SINGLE).sigma_m == LOOSE_M
    # Fixed and nothing stated: as configured.
    fixed = receiver.gga(3.0, FIXED)
    assert (fixed.sigma_m, fixed.reported_m) == (LEAST_M, LEAST_M)


def test_an_accuracy_of_another_time_says_nothing() -> None:
    receiver = Receiver()
    receiver.gga(1.0, SINGLE)
    receiver.gst(1.0, 3.0)
    receiver.gst(1.2, 0.011, of_s=0.8)
    assert receiver.place.sigma_m == pytest.approx(3.0)
    assert receiver.gga(2.0, SINGLE).sigma_m == pytest.approx(3.0)
    receiver.gst(2.2, 0.011, of_s=1.0)
    assert receiver.place.sigma_m == pytest.approx(3.0)
    alone = Receiver()
    alone.gst(0.0, 0.011)
    assert alone.gga(1.0, SINGLE).sigma_m == LOOSE_M


def test_a_heading_by_itself_keeps_the_roll_of_half_a_second() -> None:
    receiver = Receiver()
    rolls = []
    for number in range(6):
        at_s = 0.1 * number
        receiver.pashr(at_s, 6.0)
        assert receiver.senses.attitude is not None
        rolls.append(receiver.senses.attitude.roll_rad)
        receiver.hdt(at_s + 0.05)
        rolls.append(receiver.senses.attitude.roll_rad)
    assert np.degrees(rolls) == pytest.approx(6.0)
    receiver.hdt(2.0)
    assert receiver.senses.attitude is not None
    assert receiver.senses.attitude.roll_rad == 0.0


def test_a_heading_comes_with_the_accuracy_that_its_receiver_states() -> None:
    receiver = Receiver()
    receiver.pashr(0.0, 1.0, sigma_deg=45.0)
    assert receiver.senses.attitude is not None
    assert np.degrees(receiver.senses.attitude.sigma_yaw_rad) == pytest.approx(45.0)
    receiver.hdt(0.1)
    assert np.isnan(receiver.senses.attitude.sigma_yaw_rad)
