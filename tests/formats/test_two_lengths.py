"""A line's length by its header, its wheel and the receiver beside it: who is believed where they disagree."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pyproj
import pytest

from formats.samples import dzt_header, write_dt1
from formats.side_samples import dzg_text, gps_text, sentence
from lgprjax.formats import DriveLog, Survey, import_lines

_GEOD = pyproj.Geod(ellps="WGS84")
_LATITUDE, _LONGITUDE, _WAY_DEG = 48.3486, -121.046, 70.0
_TRACES = np.random.default_rng(5).integers(-9000, 9000, (400, 64))


def _fix(second: int, along_m: float, quality: int) -> str:
    longitude, latitude, _ = _GEOD.fwd(_LONGITUDE, _LATITUDE, _WAY_DEG, along_m)
    place = f"{int(latitude):02d}{60 * (latitude % 1):09.6f},N,{int(-longitude):03d}{60 * (-longitude % 1):09.6f},W"
    clock = f"10{second // 60:02d}{second % 60:02d}.00"
    return sentence(f"GPGGA,{clock},{place},{quality},12,0.8,100.000,M,45.000,M,1.0,0000")


def _sentences(along_m: np.ndarray, every: int, quality: int, until: int, noise_m: float) -> list[list[str]]:
    noise = noise_m * np.random.default_rng(2).standard_normal(len(along_m))
    return [
        [_fix(n // every, along_m[n] + noise[n], quality)] if n % every == 0 and n < until else []
        for n in range(len(along_m))
    ]


def _dt1(path: Path, step_m: float, **options: object) -> Path:
    return write_dt1(path.with_suffix(".DT1"), _TRACES, step=step_m, **options)  # type: ignore[arg-type]


def _dzt(path: Path, step_m: float) -> Path:
    file = path.with_suffix(".DZT")
    header = dzt_header(samples=64, bits=32, per_m=1.0 / step_m)
    file.write_bytes(header + _TRACES.astype("<i4").tobytes())
    return file


def _imported(path: Path) -> tuple[Survey, np.ndarray, np.ndarray]:
    """The survey; distance of every trace from the first, by its place and by the odometry."""
    survey = import_lines([path], output=path.with_suffix(".drive.h5"))
    with DriveLog.open(path.with_suffix(".drive.h5")) as log:
        track, travel_m = log.description.navigation, log.description.odometry.distance_m
    start = np.full(len(travel_m), track.longitude_deg[0]), np.full(len(travel_m), track.latitude_deg[0])
    return survey, _GEOD.inv(*start, track.longitude_deg, track.latitude_deg)[2], travel_m


@pytest.mark.parametrize(
    ("make", "true_step_m", "until", "quality"),
    [
        (lambda path: _dt1(path, 1.0), 0.025, 391, 4),
        (lambda path: _dt1(path, 0.025, unit="ft"), 0.025, 400, 4),
        (lambda path: _dt1(path, 0.02), 1.0, 360, 1),
        (lambda path: _dt1(path, 1.0, positions=1.0 * np.arange(400) + 0.2 * (np.arange(400) % 3)), 0.05, 391, 5),
        (lambda path: _dt1(path, -0.5, positions=-0.5 * np.arange(400), STEP_SIZE_USED=0.5), 0.05, 391, 4),
        (lambda path: _dzt(path, 1.0), 0.02, 391, 4),
    ],
    ids=["metres", "feet", "poor_receiver", "uneven", "backward", "wheel"],
)
def test_a_receiver_is_believed_where_it_is_sure(
    make: Callable[[Path], Path], true_step_m: float, until: int, quality: int, tmp_path: Path
) -> None:
    """Its last fix is before the last trace: the line goes on by its own step, not by the header's."""
    path = make(tmp_path / "a")
    noise_m = {4: 0.005, 5: 0.02, 1: 1.0}[quality]
    along_m = true_step_m * np.arange(400)
    rows = _sentences(along_m, 10, quality, until, noise_m)
    if path.suffix == ".DZT":
        path.with_suffix(".DZG").write_text(dzg_text({n: each for n, each in enumerate(rows) if each}), newline="")
    else:
        path.with_suffix(".GPS").write_text(gps_text(rows), newline="")
    survey, placed_m, travel_m = _imported(path)
    length_m = 399 * true_step_m
    assert placed_m[-1] == pytest.approx(length_m, rel=0.02)
    assert travel_m[-1] == pytest.approx(length_m, rel=0.02)
    (note,) = survey.notes
    assert note.startswith(f"a{path.suffix}: ")
    assert "is used" in note


@pytest.mark.parametrize(
    ("quality", "noise_m", "factor"), [(1, 4.0, 1.0), (1, 2.0, 1.6), (4, 0.02, 1.3), (5, 0.3, 1.0)]
)
def test_a_header_is_believed_within_the_noise(quality: int, noise_m: float, factor: float, tmp_path: Path) -> None:
    path = _dt1(tmp_path / "a", 0.05)
    path.with_suffix(".GPS").write_text(
        gps_text(_sentences(factor * 0.05 * np.arange(400), 10, quality, 400, noise_m)), newline=""
    )
    survey, _, travel_m = _imported(path)
    np.testing.assert_allclose(travel_m, 0.05 * np.arange(400), atol=1e-9)
    assert survey.notes == ()


@pytest.mark.parametrize("pause", [100, 45, 1000])
def test_a_receiver_that_counts_on_in_a_pause_is_not_used(pause: int, tmp_path: Path) -> None:
    """Its numbers lead beyond the last trace: nobody knows from where on they are not those of the traces."""
    path = _dzt(tmp_path / "a", 0.05)
    scans: dict[int, Sequence[str]] = {n: [_fix(n // 10, 0.05 * n, 4)] for n in range(0, 400 + pause, 10)}
    path.with_suffix(".DZG").write_text(dzg_text(scans), newline="")
    survey, placed_m, travel_m = _imported(path)
    assert survey.placed_by == "header"
    np.testing.assert_allclose(placed_m, travel_m, atol=1e-4)
    assert any(note.startswith("a.DZG: not used: traces") for note in survey.notes)


def test_a_receiver_that_stood_still_is_not_used(tmp_path: Path) -> None:
    path = _dt1(tmp_path / "a", 0.1)
    path.with_suffix(".GPS").write_text(gps_text(_sentences(0.0 * np.arange(400), 10, 4, 400, 0.01)), newline="")
    survey, _, travel_m = _imported(path)
    assert survey.placed_by == "header"
    np.testing.assert_allclose(travel_m, 0.1 * np.arange(400), atol=1e-9)
    assert any("stood still" in note for note in survey.notes)
