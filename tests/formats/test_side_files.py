"""Positions recorded beside a line: every layout and trap in files written here."""

from collections import Counter
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pynmeagps import NMEAReader

from formats.samples import write_dt1
from formats.side_samples import cor_row, dzg_text, gga, gps_text, rmc, sentence
from lgprjax.formats import find_side_files, places_of_traces, read_side_file
from lgprjax.formats.line_positions import fix_of_sentence
from lgprjax.formats.plausible import ZEROS
from refusals import refused

_PLACES = np.array([[12.5, -1.25, 10.04], [12.5, -1.0, 10.03], [12.75, -0.75, 10.02]])


def _write(path: Path, text: str | bytes) -> Path:
    path.write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return path


_TOPOGRAPHIES = [
    "E,N,Z\n12.5,-1.25,10.04\n12.5,-1,10.03\n12.75,-0.75,10.02\n",
    "N,E,Z\r\n-1.25,12.5,10.04\r\n-1,12.5,10.03\r\n-0.75,12.75,10.02\r\n",
    "12.5 -1.25 10.04\n12.5   -1 10.03\n\n12.75 -0.75 10.02",
    "# surveyed by hand\nx\ty\tz\n12.5\t-1.25\t10.04\n12.5\t-1\t10.03\n12.75\t-0.75\t10.02\n",
    "elevation;northing;easting\r10,04;-1,25;12,5\r10,03;-1;12,5\r10,02;-0,75;12,75\r",
    "point,Easting (m),Northing (m),Z_m\np1,12.5,-1.25,10.04\np2,12.5,-1,10.03\np3,12.75,-0.75,10.02\n",
    '\ufeff"X","Y","Z",,\r\n1.25e1,-1.25,10.04,,\r\n12.5,-1,10.03,,\r\n12.75,-.75,10.02,,\r\n',
]


def test_topography(tmp_path: Path) -> None:
    """Names in any order, none, other separators, comments, decimal commas, further columns, a spreadsheet's mark."""
    for text in _TOPOGRAPHIES:
        positions = read_side_file(_write(tmp_path / "topo_a.txt", text.encode()))
        np.testing.assert_array_equal(np.stack([positions.x, positions.y, positions.z], axis=1), _PLACES)
        np.testing.assert_array_equal(positions.trace, [0, 1, 2])
        assert (positions.kind, positions.numbered, positions.counts) == ("local metres", False, {"rows": 3})
        assert positions.time_s is positions.quality is positions.satellites is positions.hdop is None


def test_kinds_of_topography(tmp_path: Path) -> None:
    grid = read_side_file(_write(tmp_path / "a.xyz", "267918.654,4178496.403,1206.464061625146\n"))
    assert (grid.kind, grid.x[0], grid.y[0], grid.z[0]) == ("grid metres", 267918.654, 4178496.403, 1206.464061625146)
    degrees = read_side_file(_write(tmp_path / "a.csv", "Latitude;Longitude\n46,2;12,97\n46,3;12,98\n"))
    assert (degrees.kind, degrees.x[1], degrees.y[1]) == ("degrees", 12.98, 46.3)
    assert np.isnan(degrees.z).all()
    along = read_side_file(_write(tmp_path / "a.txt", "0\t18.749\n0.1178\t18.678\n"))
    assert (along.kind, along.x[1], along.y[1], along.z[1]) == ("along metres", 0.1178, 0.0, 18.678)
    named = read_side_file(_write(tmp_path / "b.txt", "elevation,position\n18.7,0\n18.6,2\n"))
    assert (named.kind, named.x[1], named.z[1]) == ("along metres", 2.0, 18.6)


# Text, the place, values that are named.
_BAD_TOPOGRAPHY: list[tuple[str | bytes, str, tuple[object, ...]]] = [
    ("", "file", ()),
    ("\n \n# nothing\n", "rows", ()),
    ("N,E,Z\n", "rows", ()),
    ("1,2,3\n1,2\n", "line 2", (3, 2)),
    ("1,2,3\n1,2,x\n", "line 2", ("'x'",)),
    ("1,2,3\n\n1,nan,3\n", "line 3", ("nan",)),
    ("1,2,1e9\n", "line 1", ("1e9",)),
    ("1,2,1_0\n", "line 1", ("1_0",)),
    ("1,2,3,4\n", "line 1", ("N,E,Z", 4)),
    ("N,Z\n1,2\n", "line 1", ("N,E,Z", "N Z")),
    ("N,E,Z,easting\n1,2,3,4\n", "line 1", ("easting",)),
    ("lat,lon\n46,12\n96,12\n", "row 2", (12, 96)),
    ("N,E,Z\n1,2,3\n".encode("utf-16"), "line 1", ("N,E,Z",)),
]


def test_bad_topography_is_refused(tmp_path: Path) -> None:
    for text, place, values in _BAD_TOPOGRAPHY:
        path = _write(tmp_path / "topo_a.txt", text)
        with refused(place, *values, file=path):
            read_side_file(path)


def test_gps_takes_the_first_fix_of_each_trace(tmp_path: Path) -> None:
    noise = "$GPVTG,93.5,T,93.7,M,000.1,N,000.2,K,A*22"
    damaged = gga(3).replace("4612", "4613")
    text = gps_text(
        [
            [gga(0, quality=0), rmc(9)],
            [noise, rmc(0), gga(1), gga(2)],
            [damaged, gga(3)[:30]],
            ["$GP" + gga(4) + gga(5), "25,60,106,46*70"],
            [gga(4)],
            [],
            [gga(7)],
        ]
    )
    positions = read_side_file(_write(tmp_path / "a.GPS", text))
    np.testing.assert_array_equal(positions.trace, [1, 3, 4, 6])
    np.testing.assert_allclose(positions.y, 46.2 + np.array([1, 4, 4, 7]) / 60e6, rtol=0, atol=1e-12)
    np.testing.assert_allclose(positions.x, 12 + (58 + np.array([1, 4, 4, 7]) / 1e6) / 60, rtol=0, atol=1e-12)
    np.testing.assert_allclose(positions.z, 176.25 + np.array([1, 4, 4, 7]) / 100, rtol=0, atol=1e-9)
    assert (positions.kind, positions.height, positions.numbered) == ("degrees", "ellipsoid", True)
    assert positions.time_s is not None
    np.testing.assert_array_equal(positions.time_s, 36000 + np.array([1, 4, 4, 7]))
    for values, expected in ((positions.quality, 1), (positions.satellites, 7), (positions.hdop, 1.5)):
        np.testing.assert_array_equal(values, [expected] * 4)
    assert positions.counts == {
        "rows": 4,
        "traces": 7,
        "sentences": 13,
        "failed checksum": 1,
        "cut": 2,
        "without fix": 1,
        "repeated": 1,
    }


def test_gps_of_southern_and_western_places_and_heights_without_separation(tmp_path: Path) -> None:
    body = "GNGGA,235960.50,3352.500000,S,15112.750000,W,4,12,0.6,-3.5,M,22.5,M,1.0,0001"
    positions = read_side_file(_write(tmp_path / "a.gps", gps_text([[sentence(body)]])))
    assert (positions.y[0], positions.x[0], positions.z[0]) == (-33.875, -151.2125, 19.0)
    assert positions.quality is not None
    assert positions.quality[0] == 4
    positions = read_side_file(_write(tmp_path / "a.gps", gps_text([[gga(1)], [gga(2, separation=",")]])))
    assert positions.height == "sea level"
    np.testing.assert_allclose(positions.z, [130.01, 130.02])


def test_rmc_stands_in_only_where_there_is_no_gga(tmp_path: Path) -> None:
    positions = read_side_file(_write(tmp_path / "a.gps", gps_text([[rmc(1, status="V")], [rmc(2)], [rmc(3)]])))
    np.testing.assert_array_equal(positions.trace, [1, 2])
    assert np.isnan(positions.z).all()
    assert positions.counts["without fix"] == 1


# Fields of a GGA sentence whose checksum holds: minutes, latitude, digits, side, longitude, hour, quality, height.
_NO_PLACES = {
    2: ("4660.000001", "9100.000000", "612.000001"),
    3: ("X", ""),
    4: ("18100.000000",),
    1: ("250000.00",),
    6: ("8", "6"),  # simulated, dead reckoning
    9: ("HIGH", "1e9"),
    7: ("-1",),
}


def test_sentence_whose_checksum_holds_and_whose_place_is_none(tmp_path: Path) -> None:
    for field, value in ((field, value) for field, values in _NO_PLACES.items() for value in values):
        fields = gga(1)[1:].partition("*")[0].split(",")
        fields[field] = value
        text = gps_text([[sentence(",".join(fields))], [gga(2)]])
        positions = read_side_file(_write(tmp_path / "a.gps", text))
        assert (positions.trace.tolist(), positions.counts["without fix"]) == ([1], 1), (field, value)


def test_bad_receiver_files_are_refused(tmp_path: Path) -> None:
    whole = gps_text([[gga(1)], [gga(2)], [gga(3)]])
    row = cor_row(1)
    cases: list[tuple[str, str, str, tuple[object, ...]]] = [
        ("a.GPS", "", "file", ()),
        ("a.GPS", "no such thing", "line 1", ("Trace #N", "no such thing")),
        ("a.GPS", whole.replace("Trace #2", "Trbce #2"), "line 3", ("Trace #N", "Trbce #2")),
        ("a.GPS", whole.replace("Trace #2", "Trace #0"), "line 3", ("Trace #0",)),
        ("a.GPS", whole.replace("Trace #3", "Trace #1"), "trace 0", (1, 0)),
        ("a.GPS", gga(1) + "\r\n", "positions", ("traces 0, sentences 1",)),
        ("a.GPS", gps_text([[gga(1, quality=0)]]), "positions", ("traces 1, sentences 1", "without fix 1")),
        ("a.GPS", gps_text([[rmc(1), gga(1, quality=0)]]), "positions", ("traces 1, sentences 2", "without fix 1")),
        ("a.DZG", "$GSSIS,x,-1\r\n", "line 1", ("$GSSIS,scan", "$GSSIS,x,-1")),
        ("a.DZG", dzg_text({5: [gga(1)], 3: [gga(2)]}), "trace 3", (5, 3)),
        ("a.DZG", dzg_text({5: []}), "positions", ("traces 1, sentences 0",)),
        ("a.cor", row.replace("N", "Q"), "line 1", ("Q",)),
        ("a.cor", row + row.replace("46.2", "96.2"), "line 2", ("96.2",)),
        ("a.cor", row + cor_row(5) + cor_row(4), "line 3", (4, 3)),
        (
            "a.cor",
            cor_row(1, latitude="0.0\tN", longitude="0\tE"),
            "positions",
            ("traces 1, without fix 0", f"{ZEROS} 1"),
        ),
        ("a.cor", "\r\n", "positions", ("traces 0, without fix 0",)),
        ("a.kml", "", "file name", (".xyz", ".csv", ".txt", ".gps", ".dzg", ".cor", ".kml")),
    ]
    for name, text, place, values in cases:
        path = _write(tmp_path / name, text)
        with refused(place, *values, file=path):
            read_side_file(path)
    with refused("file", file="none.GPS"):
        read_side_file(tmp_path / "none.GPS")


@settings(max_examples=300, deadline=None)
@given(
    st.integers(0, 89),
    st.integers(0, 179),
    st.decimals(0, 59, places=7),
    st.sampled_from("NS"),
    st.sampled_from("EW"),
    st.integers(0, 86_399),
    st.integers(0, 9),
    st.sampled_from(["GPGGA", "GNGGA", "GPRMC", "GNRMC"]),
)
def test_sentences_are_read_as_by_another_library(
    latitude: int, longitude: int, minutes: Decimal, north: str, east: str, second: int, quality: int, kind: str
) -> None:
    clock = f"{second // 3600:02d}{second // 60 % 60:02d}{second % 60:02d}.50"
    place = f"{latitude:02d}{minutes:010.7f},{north},{longitude:03d}{minutes:010.7f},{east}"
    rest = f"{quality},12,0.8,100.0,M,45.0,M,," if kind.endswith("GGA") else "0.5,90.0,010124,,,A"
    state = "" if kind.endswith("GGA") else "A,"
    text = sentence(f"{kind},{clock},{state}{place},{rest}")
    read, other = fix_of_sentence(text, Counter()), NMEAReader.parse(text.encode())
    assert read is not None
    if kind.endswith("GGA") and quality not in (1, 2, 3, 4, 5):
        assert read[1] is None
        return
    assert read[1] is not None
    np.testing.assert_allclose([read[1].latitude_deg, read[1].longitude_deg], [other.lat, other.lon], atol=1e-9)
    assert read[1].time_s == second + 0.5


def test_dzg_counts_scans_from_zero(tmp_path: Path) -> None:
    text = dzg_text({0: [rmc(0), gga(1)], 30: [gga(2, quality=0)], 60: [gga(3)], 61: [gga(4), gga(5)]})
    positions = read_side_file(_write(tmp_path / "a.dzg", text + "$GSSIS,61,-1\r\n" + gga(6)))
    np.testing.assert_array_equal(positions.trace, [0, 60, 61])
    np.testing.assert_allclose(positions.y, 46.2 + np.array([1, 3, 4]) / 60e6, rtol=0, atol=1e-12)
    assert positions.counts["traces"] == 4
    assert positions.counts["without fix"] == 1
    assert positions.counts["sentences"] == 7


@pytest.mark.parametrize("first", [0, 1])
def test_cor(tmp_path: Path, first: int) -> None:
    rows = [
        cor_row(first, latitude="33.5001\tS", longitude="151.2501\tW"),
        cor_row(7, latitude="33.5\tS", longitude="151.25\tW", extra=""),
        cor_row(9, latitude="0.0\tN", longitude="0.0\tE").replace("\t", "  "),
    ]
    positions = read_side_file(_write(tmp_path / "a.cor", "".join(rows)))
    np.testing.assert_array_equal(positions.trace, [0, 7 - first])
    np.testing.assert_array_equal(positions.x, [-151.2501, -151.25])
    np.testing.assert_array_equal(positions.y, [-33.5001, -33.5])
    np.testing.assert_allclose(positions.z, [130 + first / 100, 130.07])
    assert positions.height == "unstated"
    assert positions.time_s is not None
    assert positions.time_s[1] == 36007
    np.testing.assert_array_equal(positions.hdop, [1.2, np.nan])
    assert positions.counts == {"rows": 2, "traces": 3, "without fix": 0, ZEROS: 1, "repeated": 0}


def test_places_lie_between_the_measured_traces(tmp_path: Path) -> None:
    text = gps_text([[], [gga(100)], [gga(100)], [], [gga(400)], []])
    places = places_of_traces(read_side_file(_write(tmp_path / "a.gps", text)), 6)
    np.testing.assert_array_equal(places.measured, [False, True, False, False, True, False])
    # The repeated fix of trace 2 is no place of its own.
    expected = 46.2 + np.array([np.nan, 100, 200, 300, 400, np.nan]) / 60e6
    np.testing.assert_allclose(places.y, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(places.z[1:5], [177.25, 178.25, 179.25, 180.25], rtol=0, atol=1e-9)
    assert len(places_of_traces(read_side_file(tmp_path / "a.gps"), 3).x) == 3


def test_places_go_the_short_way_across_the_date_line(tmp_path: Path) -> None:
    rows = cor_row(1, longitude="179.9999\tE") + cor_row(3, longitude="179.9999\tW")
    places = places_of_traces(read_side_file(_write(tmp_path / "a.cor", rows)), 3)
    np.testing.assert_allclose(np.abs(places.x), [179.9999, 180.0, 179.9999])


def test_find_side_files(tmp_path: Path) -> None:
    line = write_dt1(tmp_path / "XLINE01.DT1", np.zeros((3, 4), int))
    assert find_side_files(line) == []
    for name in ("xline01.gps", "XLINE01.XYZ", "TOPO_xline01.TXT", "XLINE01.cor", "XLINE01.dzg", "XLINE01.csv"):
        _write(tmp_path / name, "1,2,3\n")
    for name in ("XLINE011.GPS", "topo_XLINE010.txt", "XLINE01.kml", "topo_XLINE01.csv", "GPS.xyz"):
        _write(tmp_path / name, "1,2,3\n")
    notes = _write(tmp_path / "XLINE01.txt", "walked in the rain\n")
    expected = ["TOPO_xline01.TXT", "XLINE01.XYZ", "XLINE01.csv", "xline01.gps", "XLINE01.dzg", "XLINE01.cor"]
    assert [each.name for each in find_side_files(line)] == expected
    notes.write_text("0 1.5\n3 1.6\n")
    assert notes in find_side_files(line)
    notes.write_text("")
    assert notes not in find_side_files(line)
    assert find_side_files(tmp_path / "none" / "a.DT1") == []
    # Channels of an array share a side file.
    for name in ("SITE_001.cor", "SITE_001_A01.iprb", "SITE_001_A02.cor", "SITE_002.cor"):
        _write(tmp_path / name, "x")
    assert [each.name for each in find_side_files(tmp_path / "SITE_001_A01.iprb")] == ["SITE_001.cor"]
    found = [each.name for each in find_side_files(tmp_path / "SITE_001_A02.iprb")]
    assert found == ["SITE_001_A02.cor", "SITE_001.cor"]
