"""Variants of line files: what a word of a header states is read as it states it, or the word is named."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import segyio

from canon.commands import run, succeed
from formats.samples import dzt_header, write_dt1, write_iprb
from formats.segy_sample import segy_bytes, write_segy
from lgprjax.formats import DriveLog, SurveyOrigin, import_lines, import_segy, read_dt1, read_dzt, read_segy
from refusals import refused

_DRAW = np.random.default_rng(49)
_COUNTS = _DRAW.integers(-3000, 3000, (9, 60)).astype(np.int16)
# Amplitudes of a radar: over many powers of two, and none of them round.
_FLOATS = (_DRAW.normal(size=(30, 64)) * np.exp(-np.arange(64) / 12.0)).astype(np.float32) * 1000.0
_PLACE = SurveyOrigin(48.0, 11.0, 30.0)
_REV2 = {(3269, "I"): 60, (3221, "H"): 0, (3217, "H"): 0, (3273, "d"): 4e-4}

# Words of the file; each begins its traces, or spaces them, elsewhere than revision 0 does.
_LAYOUTS: dict[str, dict[str, Any]] = {
    "revision swapped, little-endian": {"order": "<", "revision": b"\0\1", "extended": 1},
    "revision swapped, big-endian": {"revision": b"\0\1", "extended": 2},
    "revision not stated": {"extended": 1},
    "revision 2.1 swapped": {"order": "<", "revision": b"\1\2", "states": _REV2, "extended": 1},
    "additional trace header": {"revision": b"\2\0", "additional": 1, "states": _REV2 | {(3507, "i"): 1}},
    "three of them, little-endian": {
        "order": "<",
        "revision": b"\2\1",
        "additional": 3,
        "states": _REV2 | {(3507, "i"): 3},
    },
    "as many bytes as whole traces without it": {
        "revision": b"\2\0",
        "additional": 3,
        "states": _REV2 | {(3507, "i"): 3},
    },
    "offset of the first trace": {"revision": b"\2\0", "unused": 1500, "states": _REV2 | {(3521, "Q"): 5100}},
    "offset for headers without a number": {
        "revision": b"\2\1",
        "unused": 6400,
        "states": _REV2 | {(3505, "h"): -1, (3521, "Q"): 10000},
    },
    "trailers": {"revision": b"\2\0", "trailers": 2, "states": _REV2 | {(3529, "i"): 2}},
    "trailers without a number": {
        "revision": b"\2\1",
        "trailers": 1,
        "states": _REV2 | {(3529, "i"): -1, (3513, "Q"): 9},
    },
    "samples in the trace headers alone": {"states": {(3221, "H"): 0}},
}


@pytest.mark.parametrize("layout", _LAYOUTS)
def test_traces_are_where_the_headers_state(layout: str, tmp_path: Path) -> None:
    path = tmp_path / "a.sgy"
    path.write_bytes(segy_bytes(_COUNTS, **_LAYOUTS[layout]))
    profile = read_segy(path)
    np.testing.assert_array_equal(profile.traces, _COUNTS)
    assert profile.sample_interval_ns == pytest.approx(0.4)
    notes = import_segy(path, place=_PLACE, length_m=0.8, output=tmp_path / "a.drive.h5")
    assert notes == ()
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        traces, valid = log.read_traces(0, log.scans)
    np.testing.assert_array_equal(traces[valid[:, 0], 0], _COUNTS)


def test_a_layout_that_no_word_states_is_refused(tmp_path: Path) -> None:
    """Additional headers of a file that states none: their bytes are whole traces more, which are no traces."""
    path = tmp_path / "a.sgy"
    path.write_bytes(segy_bytes(_COUNTS[:, :60], additional=9, revision=b"\1\0"))
    assert (path.stat().st_size - 3600) % (240 + 120) == 0
    with refused("trace headers, samples a trace", 60, file=path):
        read_segy(path)
    # Traces of several lengths.
    path.write_bytes(segy_bytes(_COUNTS, words={(115, "H"): 60 + np.arange(9)}))
    with refused("trace headers, samples a trace", 60, found=61, file=path):
        read_segy(path)
    for word, value in (((3507, "i"), -1), ((3521, "Q"), 100), ((3521, "Q"), 10**9)):
        path.write_bytes(segy_bytes(_COUNTS, revision=b"\2\0", states=_REV2 | {word: value}))
        with refused(None, value, file=path):
            read_segy(path)


def test_floats_are_read_by_their_bits_whatever_the_header_says(tmp_path: Path) -> None:
    path = write_segy(tmp_path / "ibm.sgy", _FLOATS, code=1)
    with segyio.open(str(path), ignore_geometry=True) as store:
        ibm = store.trace.raw[:]
    for order in (">", "<"):
        stored = path.read_bytes()
        stated = {
            "ibm": np.frombuffer(stored, np.dtype([("h", "V240"), ("s", ">u4", 64)]), offset=3600)["s"],
            "ieee": _FLOATS.view(np.uint32),
        }
        for coding, words in stated.items():
            for code in (1, 5):
                wrong = (code == 1) != (coding == "ibm")
                (tmp_path / "a.sgy").write_bytes(segy_bytes(words, order=order, code=code))
                profile = read_segy(tmp_path / "a.sgy")
                np.testing.assert_array_equal(profile.traces, ibm if coding == "ibm" else _FLOATS)
                assert len(profile.notes) == wrong
                as_marked = read_segy(tmp_path / "a.sgy", sample_format="ibm" if code == 1 else "ieee")
                assert as_marked.notes == ()
                assert np.array_equal(as_marked.traces, profile.traces) != wrong
    # Few values tell nothing: as marked.
    (tmp_path / "a.sgy").write_bytes(segy_bytes(np.full((3, 8), 3.5, np.float32).view(np.uint32), code=5))
    assert np.all(read_segy(tmp_path / "a.sgy").traces == 3.5)
    with refused("sample format", "--sample-format"):
        read_segy(write_segy(tmp_path / "b.sgy"), sample_format="ibm")


def test_places_of_another_format_are_no_coordinates(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Doubles in the place of the ensemble's coordinates: a length is asked for, and no zone is."""
    monkeypatch.chdir(tmp_path)
    places = np.array([60.0 + 1e-6 * index for index in range(9)])
    for words in (
        {(181, "d"): places},
        {(73, "d"): places, (81, "d"): -places},
        {(181, "i"): (2e9 * np.cos(np.arange(9))).astype(int), (185, "i"): np.full(9, 7)},
    ):
        Path("a.sgy").write_bytes(segy_bytes(_COUNTS, order="<", words=words))
        refusal = run("import", "a.sgy", "-o", "a.drive.h5").refusal
        refusal.check("trace spacing", "--length-m", file="a.sgy")
        assert "--utm-zone" not in f"{refusal.expected}{refusal.found}"
        succeed("import", "a.sgy", "-o", "a.drive.h5", "--length-m", 0.8, "--force")


def test_what_is_whole_of_a_truncated_line_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("a.sgy").write_bytes(segy_bytes(_COUNTS)[:-7])
    run("import", "segy", "a.sgy", "-o", "a.drive.h5", "--length-m", 1).refusal.check("traces", "--partial", found=8)
    said = succeed("import", "segy", "a.sgy", "-o", "a.drive.h5", "--length-m", 1, "--partial")
    assert "8 of at least 9 traces" in said
    with DriveLog.open("a.drive.h5") as log:
        assert log.scans == 8


def _dt1_of_floats(path: Path, traces: np.ndarray, width: float = 4.0) -> Path:
    write_dt1(path, np.zeros(traces.shape), step=0.1)
    record = np.dtype([("header", "<f4", 32), ("samples", "<i2", traces.shape[1])])
    words = np.frombuffer(path.read_bytes(), record)["header"].copy()
    words[:, 5] = width
    path.write_bytes(b"".join(head.tobytes() + trace.tobytes() for head, trace in zip(words, traces, strict=True)))
    return path


def test_dt1_samples_are_as_wide_as_their_headers_state(tmp_path: Path) -> None:
    profile = read_dt1(_dt1_of_floats(tmp_path / "a.DT1", _FLOATS.astype("<f4")))
    np.testing.assert_array_equal(profile.traces, _FLOATS)
    assert profile.traces.dtype == np.float32
    cut = (tmp_path / "a.DT1").read_bytes()[:-30]
    (tmp_path / "a.DT1").write_bytes(cut)
    np.testing.assert_array_equal(read_dt1(tmp_path / "a.DT1", partial=True).traces, _FLOATS[:-1])
    for width, values in ((2.0, (60,)), (8.0, (2, 4)), (3.0, (2, 4))):
        with refused(None, *(() if width == 2.0 else values)):
            read_dt1(_dt1_of_floats(tmp_path / "b.DT1", _FLOATS.astype("<f4"), width))


@pytest.mark.parametrize("seed", range(12))
def test_as_many_valid_scans_come_out_as_traces_go_in(seed: int, tmp_path: Path) -> None:
    """Lines whose numbers jump, at any step and start, either way, as float32 places in the headers of the traces."""
    draw = np.random.default_rng(seed)
    traces = int(draw.integers(8, 200))
    step = float(draw.choice([0.01, 0.02, 0.025, 0.05, 0.1, 1.0 / 3.0]))
    number = np.cumsum(np.where(draw.random(traces) < 0.05, draw.integers(4, 30, traces), 1))
    places = float(draw.choice([0.0, 3.7, 812.35])) + step * number
    if seed % 3 == 0:
        places = places[0] + step * (np.arange(traces) + 25 * (np.arange(traces) > 0))
    counts = draw.integers(-3000, 3000, (traces, 40))
    way = -1 if seed % 2 else 1
    write_dt1(tmp_path / "a.DT1", counts, step=step, positions=places[::way])
    import_lines([tmp_path / "a.DT1"], output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        read, valid = log.read_traces(0, log.scans)
    assert np.count_nonzero(valid) == traces
    np.testing.assert_array_equal(read[valid[:, 0], 0], counts[::way])


def _two_antennas(path: Path, *later: bytes, traces: int = 20) -> np.ndarray:
    """A file of a channel more than later headers; its samples, without their marks."""
    channels = 1 + len(later)
    first = dzt_header(samples=40, bits=32, channels=channels, word=128, antenna=b"300/800D")
    stored = _DRAW.integers(-(2**20), 2**20, (traces, channels, 40))
    path.write_bytes((first + b"".join(later)).ljust(128 * 1024, b"\0") + stored.astype("<i4").tobytes())
    return np.asarray(stored[:, :, 2:])


def test_one_of_two_antennas_in_one_place_is_chosen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    other = dzt_header(samples=40, bits=32, channels=2, word=128, antenna=b"none")
    for name in ("a.DZT", "b.DZT"):
        _two_antennas(Path(name), other)
    stored = _two_antennas(Path("a.DZT"), other)
    for verb in (("import",), ("import", "dzt"), ("import", "lines")):
        refusal = run(*verb, "a.DZT", "-o", "x.drive.h5").refusal
        refusal.check("channels", "--channel", "300/800D", found=2)
        for channel in (0, 1):
            succeed(*verb, "a.DZT", "-o", "x.drive.h5", "--channel", channel, "--force")
            with DriveLog.open("x.drive.h5") as log:
                assert log.channels == 1
                np.testing.assert_array_equal(log.read_stored(0, 20)[0][:, 0, 2:], stored[:, channel])
        done = run(*verb, "a.DZT", "-o", "y.drive.h5", "--channel", 2)
        assert (done.status, done.about) == (1, "a.DZT: --channel")
    lines = ("import", "lines", "a.DZT", "b.DZT", "--line-spacing-m", 1, "-o", "y.drive.h5")
    run(*lines).refusal.check("channels", "--channel")
    succeed(*lines, "--channel", 1)
    # Side by side they are lines, as ever.
    succeed("import", "lines", "a.DZT", "--line-spacing-m", 0.5, "-o", "z.drive.h5")
    with DriveLog.open("z.drive.h5") as log:
        assert log.channels == 2


def test_a_receiver_beside_two_antennas_does_not_make_two_passes_of_them(tmp_path: Path) -> None:
    _two_antennas(tmp_path / "a.DZT", dzt_header(samples=40, bits=32, channels=2, word=128))
    (tmp_path / "a.xyz").write_text("".join(f"{0.02 * row:.2f} 0 10\n" for row in range(20)))
    with refused("channels", "--channel"):
        import_lines([tmp_path / "a.DZT"], output=tmp_path / "a.drive.h5")


def test_a_later_header_counts_where_it_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    whole = dzt_header(samples=40, bits=32, channels=2, word=128, antenna=b"800MHz", range_ns=2.0, position_ns=-0.5)
    noise = np.random.default_rng(2).bytes(1024)
    for later, interval_ns, notes in (
        (whole, 0.05, 0),
        (bytes(1024), 0.1, 1),
        (b"\xff" * 1024, 0.1, 1),
        (noise, 0.1, 1),
    ):
        stored = _two_antennas(Path("a.DZT"), later)
        profile = read_dzt("a.DZT", channel=1)
        np.testing.assert_array_equal(profile.channels[:, 0, 2:], stored[:, 1])
        assert profile.sample_interval_ns == pytest.approx(interval_ns)
        assert len(profile.notes) == notes
        assert read_dzt("a.DZT", channel=0).sample_interval_ns == pytest.approx(0.1)
        said = succeed("import", "dzt", "a.DZT", "--channel", 1, "-o", "x.drive.h5", "--force")
        assert said.count("note: ") == notes
        succeed("view", "a.DZT", "--channel", 1, "-o", "x.png", "--force")
    # Together they would share one time axis, which they have not.
    _two_antennas(Path("a.DZT"), whole)
    run("view", "a.DZT", "-o", "y.png").refusal.check("header of channel 1, position_ns", "--channel", found=-0.5)


def test_options_of_several_lines_reach_their_readers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    write_iprb(Path("a.iprb"))
    Path("a.iprb").write_bytes(Path("a.iprb").read_bytes()[:-3])
    run("import", "a.iprb", "-o", "x.drive.h5").refusal.check("traces", "--partial", found=4)
    assert "4 of 5 traces" in succeed("import", "a.iprb", "-o", "x.drive.h5", "--partial")
    for name in ("b.sgy", "c.sgy"):
        Path(name).write_bytes(segy_bytes(_FLOATS.view(np.uint32), code=1))
    lines = ("import", "lines", "b.sgy", "c.sgy", "--line-spacing-m", 1, "--length-m", 3, "-o", "y.drive.h5")
    assert succeed(*lines).count("the samples are IEEE floats") == 2
    assert "IEEE floats" not in succeed(*lines, "--sample-format", "ibm", "--force")
    run(*lines, "--channel", 1, "--force").refusal.check("--channel", file="b.sgy", found=1)
    write_dt1(Path("d.DT1"), _COUNTS)
    run("import", "lines", "d.DT1", "-o", "z.drive.h5", "--sample-format", "ibm").refusal.check("file name", "SEG-Y")
