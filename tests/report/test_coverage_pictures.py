"""Pictures of a worked field: colours where the cells are, and the corner that nobody drove to."""

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from lgprjax.report import CoverChannelsPicture, CoverPicture, draw_cover_channels, draw_coverage
from lgprjax.report.coverage import COLOURS, CoverPlanPicture, draw_cover_plan, level_colours
from refusals import refused

BOX = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
KIND = np.array([[0, 1, 1, 2], [2, 2, 3, 3], [3, 3, 3, 3]])
"""One cell of the first kind, two of the second, three of the third, six of the last."""


def picture_of(states: np.ndarray) -> CoverPicture:
    """Cells of the field, with those around it that nothing was done on."""
    return CoverPicture(
        name="field",
        perimeter_m=BOX,
        east_m=-1.0,
        north_m=-1.0,
        cell_m=1.0,
        inside=np.pad(np.ones((3, 4), bool), 1),
        levels=(0.95, 0.996),
        states=np.pad(states, ((0, 0), (1, 1), (1, 1))).astype(np.uint8),
        swaths_m=(np.array([[0.0, 0.5], [4.0, 0.5]]),),
        stops_m=np.full((1, 2), 2.0),
    )


def shares(path: Path, colours: tuple[str, ...]) -> np.ndarray:
    """Of the picture in each colour."""
    pixels = matplotlib.image.imread(path)[..., :3]
    return np.array([np.mean(np.all(np.abs(pixels - to_rgb(each)) < 0.02, axis=-1)) for each in colours])


def test_each_kind_of_cell_has_its_colour(tmp_path: Path) -> None:
    low, high = np.array([0, 1, 2, 2])[KIND], np.array([0, 0, 1, 2])[KIND]
    draw_coverage(picture_of(np.stack([low, high])), tmp_path / "m.png")
    found = shares(tmp_path / "m.png", COLOURS)
    np.testing.assert_allclose(found / found.sum(), np.array([1, 2, 3, 6]) / 12, atol=0.05)
    with refused("output", "--force", file="m.png"):
        draw_coverage(picture_of(np.stack([low, high])), tmp_path / "m.png")


def test_any_number_of_levels_is_drawn(tmp_path: Path) -> None:
    colours = tuple(level_colours(3))
    assert colours[-1] == COLOURS[-1]
    # Processed up to a level, uncertain at the others.
    states = np.stack([np.where(level <= KIND - 1, 2, 1) for level in range(3)])
    draw_coverage(replace(picture_of(states), levels=(0.9, 0.95, 0.99)), tmp_path / "m.png")
    found = shares(tmp_path / "m.png", colours)
    np.testing.assert_allclose(found / found.sum(), np.array([2, 3, 6]) / 11, atol=0.05)
    assert len(level_colours(1)) == 1


def test_channels_are_drawn_also_where_nothing_is_known(tmp_path: Path, drawn: list[Figure]) -> None:
    count = 60
    for known in (True, False):
        channels = CoverChannelsPicture(
            time_s=np.concatenate([0.1 * np.arange(30), 5000.0 + 0.1 * np.arange(30)]),
            depth_m=np.full(count, 0.15 if known else np.nan),
            speed_mps=np.linspace(0.0, 0.4, count),
            sigma_m=np.full(count, 0.02 if known else 0.0),
            counts=np.full(count, known),
            fixed=np.full(count, known),
            stopped=np.arange(count) % 20 > 15,
        )
        draw_cover_channels(channels, tmp_path / f"{known}.png")
    assert len({len(figure.axes) for figure in drawn}) == 1
    with refused("output", "--force", file="True.png"):
        draw_cover_channels(channels, tmp_path / "True.png")


def test_the_picture_of_a_plan_marks_the_computed_corner(tmp_path: Path, drawn: list[Figure]) -> None:
    swaths = (np.array([[0.0, 0.6], [4.0, 0.6]]), np.array([[4.0, 1.6], [0.0, 1.6]]))
    for corner in (None, BOX[3]):
        picture = CoverPlanPicture(
            title="f", caption="c", perimeter_m=BOX, ground_m=(), keep_outs_m=(), swaths_m=swaths, forward_m=(),
            reverse_m=(), width_m=1.2, computed_m=corner,
        )  # fmt: skip
        draw_cover_plan(picture, tmp_path / "p.png", force=True)
    plain, marked = ([np.concatenate(line.get_data()).tolist() for line in each.axes[0].lines] for each in drawn)
    assert BOX[3].tolist() not in plain
    assert marked == [*plain, BOX[3].tolist()]
