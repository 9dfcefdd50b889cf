"""Radargrams: a known reflector lies at its time and place in what the axes hold, and the axes say what they are."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from lgprjax.formats import Profile
from lgprjax.radar import Radargram, clear_view
from lgprjax.report import (
    LinePlan,
    LineView,
    MapStations,
    draw_line,
    draw_map_slices,
    draw_radargram,
    even_columns,
    radargram_of,
    slice_map,
    write_line_page,
)
from lgprjax.report.radargram import caption_of
from refusals import refused

STEP_M, INTERVAL_NS, ZERO_NS = 0.1, 0.5, 10.0
AT_M, AT_NS = 7.3, 62.0


def ricker(time_ns: np.ndarray, frequency_hz: float) -> np.ndarray:
    """A wavelet whose largest value, 1, lies at 0."""
    shape = (np.pi * frequency_hz * 1e-9 * time_ns) ** 2
    return np.asarray((1.0 - 2.0 * shape) * np.exp(-shape))


def point_line(*, start_m: float = 2.0) -> Profile:
    """A surface return everywhere, and one reflector of a single trace, 60 dB below it."""
    time_ns = np.arange(240) * INTERVAL_NS - ZERO_NS
    traces = np.tile(1e6 * ricker(time_ns, 1e8), (100, 1))
    place_m = start_m + np.arange(100) * STEP_M
    at = int(np.argmin(np.abs(place_m - AT_M)))
    traces[at] += 1e3 * ricker(time_ns - AT_NS, 1e8)
    return Profile(
        path=Path("LINE01.DT1"),
        channels=traces[:, None, :],
        sample_interval_ns=INTERVAL_NS,
        time_zero_ns=ZERO_NS,
        spacing_m=STEP_M,
        centre_frequency_hz=1e8,
        positions_m=place_m,
        metadata={},
    )


def largest_at(radargram: Radargram) -> tuple[float, float]:
    """Where the picture that matplotlib holds is brightest, by its own extent: distance and time."""
    axes = draw_radargram(radargram, Figure().add_subplot())
    (image,) = axes.images
    shown = np.asarray(image.get_array())
    left, right, bottom, top = image.get_extent()
    row, column = np.unravel_index(int(np.nanargmax(shown)), shown.shape)
    assert axes.yaxis_inverted()
    assert image.origin == "upper"
    x = left + (column + 0.5) * (right - left) / shown.shape[1]
    return float(x), float(top + (row + 0.5) * (bottom - top) / shown.shape[0])


def test_a_reflector_lies_at_its_distance_and_time() -> None:
    line = point_line()
    assert largest_at(clear_view(radargram_of(line))) == pytest.approx((AT_M, AT_NS))
    # Raw, the surface return is the largest. Falling positions keep their order and their places.
    assert largest_at(radargram_of(line))[1] == pytest.approx(0.0)
    assert line.positions_m is not None
    back = replace(line, channels=line.channels[::-1], positions_m=line.positions_m[::-1].copy())
    assert largest_at(clear_view(radargram_of(back))) == pytest.approx((AT_M, AT_NS))


def test_falling_positions_with_a_gap_keep_it_open() -> None:
    places = 0.1 * np.arange(100) + 2.0 * (np.arange(100) >= 50)
    falling = replace(point_line(), spacing_m=None, positions_m=places[::-1])
    held = radargram_of(falling)
    assert (held.along[0], held.along[-1]) == pytest.approx((11.9, 0.0))
    assert np.all(np.diff(held.along) < 0.0)
    assert np.isnan(held.amplitude[np.abs(held.along - 5.95) < 0.4]).all()
    assert np.isfinite(held.amplitude[np.abs(held.along - 5.95) > 1.1]).all()


def test_axes_say_what_they_are() -> None:
    figure = Figure()
    axes = draw_radargram(radargram_of(point_line()), figure.add_subplot(), wave_speed_m_per_ns=0.125)
    figure.draw_without_rendering()
    assert "(m)" in axes.get_xlabel()
    assert "(ns)" in axes.get_ylabel()
    (depth,) = axes.child_axes
    assert "0.125 m/ns" in depth.get_ylabel()
    # Above time zero there is time, but no depth; both begin at the same height.
    assert axes.get_ylim()[1] == pytest.approx(-ZERO_NS - INTERVAL_NS / 2)
    assert min(depth.get_yticks()) == 0.0
    assert np.asarray(depth.get_ylim()) == pytest.approx(np.asarray(axes.get_ylim()) * 0.0625)
    assert [np.asarray(line.get_ydata()).tolist() for line in axes.lines] == [[0.0, 0.0]]
    (image,) = axes.images
    assert image.norm.vmin == -image.norm.vmax  # type: ignore[operator]


def test_without_distances_traces_are_counted() -> None:
    for positions_m in (None, np.full(100, 3.0)):
        radargram = radargram_of(replace(point_line(), spacing_m=None, positions_m=positions_m))
        axes = draw_radargram(radargram, Figure().add_subplot())
        assert "(m)" not in axes.get_xlabel()
        assert axes.get_xlim() == (-0.5, 99.5)


def test_very_many_traces_are_thinned_and_keep_their_places() -> None:
    line = point_line()
    long = replace(line, channels=np.repeat(line.channels, 150, axis=0), positions_m=None)
    radargram = radargram_of(long)
    assert len(radargram.along) <= 6000
    assert radargram.along[-1] == pytest.approx(STEP_M * (len(long.channels) - 1), abs=3 * STEP_M)


def test_uneven_places_are_laid_on_a_grid_and_gaps_stay_open() -> None:
    place_m = np.concatenate([[0.0, 0.0, 0.1, 0.05, 0.2, 0.3], 0.4 + 0.1 * np.arange(20), 5.0 + 0.1 * np.arange(5)])
    grid_m, chosen = even_columns(place_m)
    assert grid_m[0] == 0.0
    assert grid_m[-1] == pytest.approx(5.4)
    np.testing.assert_allclose(np.diff(grid_m), 0.1)
    assert (chosen[:4] == [0, 2, 4, 5]).all()
    assert (chosen[(grid_m > 2.9) & (grid_m < 4.4)] == -1).all()
    assert chosen[-1] == len(place_m) - 1
    # A drive that never moves has one place.
    assert [len(each) for each in even_columns(np.zeros(9))] == [1, 1]


def test_odd_recordings_draw(tmp_path: Path) -> None:
    silent = np.zeros((5, 30))
    gap = np.random.default_rng(2).normal(size=(5, 30))
    gap[2] = np.nan
    for number, amplitude in enumerate((silent, gap, np.full((5, 30), np.nan), np.ones((1, 1)), np.ones((2, 3)))):
        radargram = Radargram(
            name="odd",
            amplitude=amplitude,
            along=np.arange(float(len(amplitude))),
            in_metres=True,
            time_ns=np.arange(amplitude.shape[1]) * 0.5,
            centre_frequency_hz=1e8 if number % 2 else None,
        )
        draw_line(LineView(title="odd", radargrams=(clear_view(radargram), radargram)), tmp_path / f"{number}.png")


def line_view() -> LineView:
    plan = LinePlan(
        east_m=np.linspace(0.0, 10.0, 50)[:, None] * np.ones(2),
        north_m=np.linspace(0.0, 4.0, 50)[:, None] + np.array([0.2, -0.2]),
        distance_m=np.linspace(0.0, 10.8, 50),
        shown=(1,),
        origin="somewhere",
    )
    return LineView(title="A <line>", radargrams=(clear_view(radargram_of(point_line())),), plan=plan)


def test_the_caption_names_the_gain_of_every_channel() -> None:
    clear = clear_view(radargram_of(point_line()))
    other = replace(clear, steps=(*clear.steps[:2], "gain of another"))
    view = LineView(title="two", radargrams=(clear, other), speed_is="given", notes=("A note.",))
    told = caption_of(view)
    assert clear.steps[2] in told
    assert "gain of another" in told
    assert "0.10 m/ns" in told
    assert told.endswith("A note.")
    assert clear.steps[2] not in caption_of(replace(view, radargrams=(radargram_of(point_line()),)))


def test_a_page_needs_nothing_from_outside(tmp_path: Path) -> None:
    path = tmp_path / "a.html"
    draw_line(line_view(), tmp_path / "a.png")
    with refused("output", "--force", file="a.png"):
        draw_line(line_view(), tmp_path / "a.png")
    write_line_page(line_view(), path)
    text = path.read_text(encoding="utf-8")
    assert "A &lt;line&gt;" in text
    assert not re.search(r'(src|href)="(?!data:)', text)
    assert "http" not in text
    data = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert data is not None
    radargram, plan = json.loads(data[1])["panels"]
    assert radargram["x"] == pytest.approx([1.95, 11.95])
    assert radargram["y"] == pytest.approx([-10.25, 109.75])
    assert radargram["src"].startswith("data:image/png;base64,")
    assert plan["equal"]
    assert len(plan["lines"]) == 2


def map_stations(*, wide: bool) -> MapStations:
    """Lines along a road that leads north-east, with one loud place."""
    along, cross = np.meshgrid(np.arange(0.0, 20.0, 0.1), np.arange(0.0, 8.0 if wide else 0.8, 0.2))
    along, cross = along.ravel(), cross.ravel()
    east, north = (along - cross) / np.sqrt(2.0), (along + cross) / np.sqrt(2.0)
    loud = np.exp(-((along - 15.0) ** 2 + (cross - 0.4) ** 2) / 0.1)
    return MapStations(
        name="road",
        east_m=east,
        north_m=north,
        baseline=(cross > 0.3).astype(np.int64),
        level=np.stack([np.ones(len(east)), 1.0 + loud], axis=1),
        time_ns=np.array([10.0, 20.0]),
        window_ns=4.0,
        step_m=0.1,
        pitch_m=0.2,
        origin="somewhere",
    )


@pytest.mark.parametrize("wide", [False, True])
def test_the_loud_place_of_a_map_lies_where_it_is(wide: bool, tmp_path: Path) -> None:
    stations = map_stations(wide=wide)
    slices = slice_map(stations)
    row, column = np.unravel_index(int(np.nanargmax(slices.level[1])), slices.level[1].shape)
    found = slices.x_m[column], slices.y_m[row]
    # A road is drawn along its own axis, a field with east and north.
    assert slices.equal == wide
    assert found == pytest.approx(((15.0 - 0.4) / 2**0.5, (15.0 + 0.4) / 2**0.5) if wide else (15.0, 0.4), abs=0.15)
    if not wide:
        assert "45°" in slices.labels[0]
    draw_map_slices(stations, tmp_path / "map.png")
