"""Receiver logs of a cart whose dates, times, checksums or places are not all right: what is kept, and what is said."""

import json
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from pyubx2 import GET, UBXMessage

from canon.commands import run as run_words
from lgprjax.formats.plausible import ASTRAY, ZEROS
from lgprjax.runtime.cart import CartFixes, read_cart_fixes
from refusals import refused
from runtime.test_cart import FRAME, VEHICLE, degrees, sentence

TRUE = datetime(2024, 1, 1, 23, 58, 30, tzinfo=UTC)
COUNT = 600
STEP_S = 0.2
Date = Callable[[float, datetime], str]


def place(number: int) -> tuple[float, float]:
    """A straight walk of 0.5 m/s to the east."""
    latitude, longitude, _ = FRAME.to_geodetic(*(np.array([each]) for each in (0.1 * number, 0.0, 0.0)))
    return float(latitude[0]), float(longitude[0])


def fix(
    number: int,
    *,
    date: Date = lambda _s, utc: f"{utc:%d%m%y}",
    shift_s: float = 0.0,
    at: tuple[float, float] | None = None,
    dated: bool = True,
) -> str:
    """GGA, RMC and GST of an epoch."""
    since_s = STEP_S * number
    utc = TRUE + timedelta(seconds=since_s + shift_s)
    clock = f"{utc:%H%M%S}.{utc.microsecond // 10000:02d}"
    latitude, longitude = at or place(number)
    there = f"{degrees(latitude, 2, 'NS')},{degrees(longitude, 3, 'EW')}"
    lines = [sentence(f"GNGGA,{clock},{there},4,12,0.8,100.0,M,45.0,M,1.0,0000")]
    if dated:
        lines.append(sentence(f"GNRMC,{clock},A,{there},0.5,90.0,{date(since_s, utc)},,,A"))
    return "".join([*lines, sentence(f"GNGST,{clock},0.02,,,,0.010,0.010,0.020")])


def read(folder: Path, data: str | bytes) -> CartFixes:
    (folder / "a.nmea").write_bytes(data.encode("latin-1") if isinstance(data, str) else data)
    return read_cart_fixes(folder / "a.nmea")


def check(fixes: CartFixes, numbers: np.ndarray) -> None:
    """Times and places of the epochs are the true ones."""
    np.testing.assert_allclose(fixes.utc_ns / 1e9 - TRUE.timestamp(), STEP_S * numbers, atol=0.011)
    east, _, _ = FRAME.to_local(fixes.latitude_deg, fixes.longitude_deg, np.zeros(len(numbers)))
    np.testing.assert_allclose(east, 0.1 * numbers, atol=0.01)


def shifted(days: int, *, until_s: float, begin_s: float = 0.0) -> Date:
    def date(since_s: float, utc: datetime) -> str:
        return f"{utc + timedelta(days=days if begin_s <= since_s < until_s else 0):%d%m%y}"

    return date


@pytest.mark.parametrize(
    ("date", "wrong"),
    [
        (lambda s, utc: "120136" if s < 40.0 else f"{utc:%d%m%y}", 200),
        (lambda s, utc: "060180" if s < 40.0 else f"{utc:%d%m%y}", 200),
        (shifted(-7168, until_s=60.0, begin_s=20.0), 200),
        (shifted(1, until_s=STEP_S), 1),
        (lambda s, utc: "" if s < 40.0 else f"{utc:%d%m%y}", 0),
    ],
    ids=["future", "first_week", "week_number_for_a_while", "one_message", "no_date_at_first"],
)
def test_a_date_that_is_wrong_for_a_while_loses_no_position(date: Date, wrong: int, tmp_path: Path) -> None:
    fixes = read(tmp_path, "".join(fix(n, date=date) for n in range(COUNT)))
    check(fixes, np.arange(COUNT))
    # Midnight falls among the wrong dates of some.
    told = sum(int(note.split()[0]) for note in fixes.notes)
    assert told == wrong


def test_a_first_minute_before_a_silence_follows_the_rest(tmp_path: Path) -> None:
    """The receiver starts again: nothing but the rest of the log tells the date of its first records."""
    numbers = np.concatenate([np.arange(150), np.arange(400, COUNT)])
    fixes = read(tmp_path, "".join(fix(n, date=shifted(4394, until_s=30.0)) for n in numbers))
    check(fixes, numbers)
    assert any(note.startswith("150 ") for note in fixes.notes)
    late = read(tmp_path, "".join(fix(n, date=shifted(-7168, until_s=1e9, begin_s=100.0)) for n in numbers))
    check(late, numbers)
    undated = read(tmp_path, "".join(fix(n, dated=n >= 400) for n in numbers))
    check(undated, numbers)


def test_two_sessions_keep_their_days_in_any_order(tmp_path: Path) -> None:
    first, second = ("".join(fix(n, shift_s=shift) for n in range(200)) for shift in (0.0, 2 * 86400.0 + 7000.0))
    for text in (first + second, second + first):
        fixes = read(tmp_path, text)
        assert len(fixes.utc_ns) == 400
        assert np.all(np.diff(fixes.utc_ns) > 0)
        assert fixes.utc_ns[200] / 1e9 - TRUE.timestamp() == pytest.approx(2 * 86400.0 + 7000.0, abs=0.02)
        assert fixes.notes == ()


def test_a_clock_that_is_set_back_repeats_times_and_it_is_said(tmp_path: Path) -> None:
    """GPS time at first, then UTC: the repeated 18 s are left out, not woven into the others."""
    fixes = read(tmp_path, "".join(fix(n, shift_s=18.0 if n < 200 else 0.0) for n in range(COUNT)))
    assert len(fixes.utc_ns) == COUNT - 90
    east, _, _ = FRAME.to_local(fixes.latitude_deg, fixes.longitude_deg, np.zeros(len(fixes.utc_ns)))
    assert np.all(np.diff(east) > 0.0)
    assert any("90 of 600" in note for note in fixes.notes)


def test_zeros_and_places_out_of_reach_are_left_out(tmp_path: Path) -> None:
    bad: dict[int, tuple[float, float]] = dict.fromkeys((0, 1, 77, 78), (0.0, 0.0))
    far = dict.fromkeys(range(300, 330), (40.2, -100.0)) | {500: (place(500)[0], 80.0)}
    fixes = read(tmp_path, "".join(fix(n, at=(bad | far).get(n)) for n in range(COUNT)))
    check(fixes, np.array([n for n in range(COUNT) if n not in bad | far]))
    (note,) = fixes.notes
    assert f"4 {ZEROS}" in note
    assert f"31 {ASTRAY}" in note


def test_a_log_of_zeros_is_refused(tmp_path: Path) -> None:
    with refused("positions", ZEROS):
        read(tmp_path, "".join(fix(n, at=(0.0, 0.0)) for n in range(20)))


def without_checksums(text: str) -> str:
    return "\r\n".join(line[:-3] for line in text.splitlines()) + "\r\n"


def _without_separation(text: str) -> str:
    lines = text.splitlines()
    return "".join(sentence(line[1:-3].replace("100.0,M,45.0,M", "100.0,M,,M")) for line in lines)


def _stamped(text: str) -> str:
    return "".join(f"2024-01-01T23:58:30.123 [{n}] {line}\n" for n, line in enumerate(text.splitlines()))


def _stamped_behind(text: str) -> str:
    return "".join(f"{line};17041{n:05d}.25\n" for n, line in enumerate(text.splitlines()))


def _with_corrections(text: str) -> str:
    """RTCM frames between the sentences, whose bytes are anything, signs of a beginning among them."""
    frames = (b"\xd3\x00\x08$\xb5b\x01\x07\x5c\x00$".decode("latin-1"), "\xd3\x00\x13>\xd0$GNGGA,\x8b\xb5")
    return "".join(f"{line}\r\n{frames[n % 2] if n % 5 == 0 else ''}" for n, line in enumerate(text.splitlines()))


@pytest.mark.parametrize(
    ("written", "said"),
    [
        (without_checksums, "checksum"),
        (_without_separation, "separation"),
        (_stamped, ""),
        (_stamped_behind, ""),
        (_with_corrections, "damaged"),
    ],
)
def test_other_ways_to_write_a_log(written: Callable[[str], str], said: str, tmp_path: Path) -> None:
    fixes = read(tmp_path, written("".join(fix(n) for n in range(COUNT))))
    check(fixes, np.arange(COUNT))
    assert said in " ".join(fixes.notes)
    assert bool(said) == bool(fixes.notes)
    assert np.isfinite(fixes.height_m).all() == (said != "separation")


def pvt(number: int, **changes: int) -> bytes:
    utc = TRUE + timedelta(seconds=STEP_S * number)
    latitude, longitude = place(number)
    fields = {"year": utc.year, "month": utc.month, "day": utc.day, "hour": utc.hour, "min": utc.minute}
    fields |= {"second": utc.second, "nano": utc.microsecond * 1000, "validDate": 1, "validTime": 1, "fixType": 3}
    fields |= {"gnssFixOk": 1, "carrSoln": 2, "height": 100_000, "hAcc": 14, "iTOW": 1000 * number} | changes
    return bytes(UBXMessage("NAV", "NAV-PVT", GET, lat=latitude, lon=longitude, **fields).serialize())


def test_ubx_whose_dates_become_valid_late(tmp_path: Path) -> None:
    def message(n: int) -> bytes:
        return pvt(n, year=2015, month=10, day=18, validDate=int(n >= 50)) if n < 100 else pvt(n)

    fixes = read(tmp_path, b"".join(message(n) for n in range(COUNT)))
    check(fixes, np.arange(COUNT))
    assert [note.split()[0] for note in fixes.notes] == ["50"]


def test_ubx_and_sentences_of_one_receiver(tmp_path: Path) -> None:
    fixes = read(tmp_path, b"".join(pvt(n) + fix(n).encode() for n in range(COUNT)))
    check(fixes, np.arange(COUNT))


def test_the_last_sentences_are_read_behind_an_unfinished_message(tmp_path: Path) -> None:
    """The start of a message within other bytes, whose length reaches beyond the file's end."""
    text = [fix(n).encode() for n in range(60)]
    fixes = read(tmp_path, b"".join([*text[:50], b"\xb5\x62\x01\x07\x00\x0f", *text[50:]]))
    check(fixes, np.arange(60))
    fixes = read(tmp_path, b"".join(text)[:-4])
    check(fixes, np.arange(60))


def test_the_record_says_what_was_left_out(tmp_path: Path) -> None:
    (tmp_path / "c.vehicle.toml").write_text(VEHICLE)
    latitude, longitude, _ = FRAME.to_geodetic(*np.array([[5.0, 45, 45, 5], [-2.0, -2, 2, 2], [0.0] * 4]))
    ring = [[float(x), float(y)] for x, y in zip(longitude, latitude, strict=True)]
    (tmp_path / "f.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}))
    words = ("cover", "plan", tmp_path / "f.geojson", "--vehicle", tmp_path / "c.vehicle.toml")
    assert run_words(*words, "-o", tmp_path / "f.cover.geojson").status == 0
    date = shifted(4394, until_s=40.0)
    (tmp_path / "a.nmea").write_text(
        "".join(fix(n, date=date, at=(0.0, 0.0) if n == 3 else None) for n in range(COUNT))
    )
    words = ("cover", "record", tmp_path / "a.nmea", "--plan", tmp_path / "f.cover.geojson")
    done = run_words(*words, "--cart", tmp_path / "c.vehicle.toml", "-o", tmp_path / "r.worked.h5")
    assert done.status == 0, done.err
    assert "200 messages have the date" in done.out + done.err
    assert f"left out 1 of 600 positions (1 {ZEROS})" in done.out + done.err
