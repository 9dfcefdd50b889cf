"""Pictures of a worked field: colours where the cells are, and lightnesses that tell them apart in print."""

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from lgprjax.errors import InputError
from lgprjax.report import CoverChannelsPicture, CoverPicture, draw_cover_channels, draw_coverage
from lgprjax.report.coverage import COLOURS, level_colours


def picture_of(states: np.ndarray, stops: int = 1) -> CoverPicture:
    shape = states.shape[1:]
    return CoverPicture(
        name="field",
        perimeter_m=np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]),
        east_m=-1.0,
        north_m=-1.0,
        cell_m=1.0,
        inside=np.pad(np.ones((shape[0] - 2, shape[1] - 2), bool), 1),
        levels=(0.95, 0.996),
        states=states,
        swaths_m=(np.array([[0.0, 0.5], [4.0, 0.5]]), np.array([[4.0, 1.5], [2.0, 1.5], [0.0, 1.5]])),
        stops_m=np.full((stops, 2), 2.0),
    )


def share(path: Path, colour: str) -> float:
    pixels = matplotlib.image.imread(path)[..., :3]
    return float(np.mean(np.all(np.abs(pixels - to_rgb(colour)) < 0.02, axis=-1)))


@pytest.mark.parametrize("kind", range(4))
def test_each_kind_of_cell_has_its_colour(tmp_path: Path, kind: int) -> None:
    low, high = ((0, 0), (1, 0), (2, 1), (2, 2))[kind]
    states = np.stack([np.full((5, 6), low, np.uint8), np.full((5, 6), high, np.uint8)])
    draw_coverage(picture_of(states), tmp_path / "m.png")
    shares = [share(tmp_path / "m.png", colour) for colour in COLOURS]
    assert np.argmax(shares) == kind
    assert shares[kind] > 0.1
    # The others are in the legend only.
    assert all(each < 0.01 for number, each in enumerate(shares) if number != kind)
    with pytest.raises(InputError, match="one that exists"):
        draw_coverage(picture_of(states), tmp_path / "m.png")


@pytest.mark.parametrize("levels", [(0.99,), (0.9, 0.95, 0.99)])
def test_any_number_of_levels_is_drawn(tmp_path: Path, levels: tuple[float, ...]) -> None:
    colours = level_colours(len(levels))
    assert colours[-1] == COLOURS[-1]
    for number, colour in enumerate(colours):
        # Processed up to this level, uncertain at the others.
        states = np.stack([np.full((5, 6), 2 if each <= number else 1, np.uint8) for each in range(len(levels))])
        draw_coverage(replace(picture_of(states), levels=levels), tmp_path / f"{number}.png")
        assert share(tmp_path / f"{number}.png", colour) > 0.1
        assert sum(share(tmp_path / f"{number}.png", each) for each in colours if each != colour) < 0.02


def test_kinds_differ_in_lightness() -> None:
    linear = [
        np.array([c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in to_rgb(each)])
        for each in COLOURS
    ]
    lightness = sorted(116.0 * float(np.cbrt(each @ [0.2126, 0.7152, 0.0722])) - 16.0 for each in linear)
    assert min(np.diff(lightness)) > 8.0


@pytest.mark.parametrize("known", [True, False])
def test_channels_are_drawn_also_where_nothing_is_known(tmp_path: Path, known: bool) -> None:
    count = 60
    channels = CoverChannelsPicture(
        time_s=np.concatenate([0.1 * np.arange(30), 5000.0 + 0.1 * np.arange(30)]),
        depth_m=np.full(count, 0.15 if known else np.nan),
        speed_mps=np.linspace(0.0, 0.4, count),
        sigma_m=np.full(count, 0.02 if known else 0.0),
        counts=np.full(count, known),
        fixed=np.full(count, known),
        stopped=np.arange(count) % 20 > 15,
    )
    draw_cover_channels(channels, tmp_path / "c.png")
    assert share(tmp_path / "c.png", "#ffffff") < 0.98
