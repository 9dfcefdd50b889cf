"""Pictures of calibrations: written whole, and showing the numbers that they were given."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread

from lgprjax.report import (
    Branch,
    Curve,
    EncoderPicture,
    LookAheadSweep,
    Points,
    ServoResponse,
    draw_encoder_fit,
    draw_fitted_curve,
    draw_look_ahead,
    draw_palm_tree,
    draw_servo_steps,
)
from lgprjax.report.motion_pictures import stability_limit
from lgprjax.report.steering_pictures import lay_arc
from refusals import refused

_RANDOM = np.random.default_rng(3)


def branch(curvature: float, front_deg: float, *, noise_m: float = 0.0) -> Branch:
    """A quarter circle, or a straight line, from (4, 1) towards the north-east: centre and angle by hand."""
    way = np.linspace(0.0, 8.0, 41)
    yaw = 0.6
    if curvature:
        turned = yaw + curvature * way
        east = 4.0 + (np.sin(turned) - np.sin(yaw)) / curvature
        north = 1.0 - (np.cos(turned) - np.cos(yaw)) / curvature
    else:
        east, north = 4.0 + way * np.cos(yaw), 1.0 + way * np.sin(yaw)
    noise = noise_m * _RANDOM.normal(size=(2, len(way)))
    return Branch(east + noise[0], north + noise[1], way, curvature, float(np.radians(front_deg)))


def encoder_picture() -> EncoderPicture:
    volts = np.concatenate([np.linspace(1.4, 3.4, 6), np.linspace(3.4, 1.4, 6)])
    rising = np.arange(12) < 6
    counts = 6000.0 * volts + np.where(rising, 15.0, -15.0)
    line = np.linspace(counts.min(), counts.max(), 11)
    fitted = (line - 15.0) / 6000.0, (line + 15.0) / 6000.0
    return EncoderPicture(counts, volts, counts, volts + 0.001, rising, volts, line, *fitted, 2.0)


def sweep() -> LookAheadSweep:
    look, speed = np.linspace(2.0, 10.0, 9), np.linspace(1.0, 5.0, 5)
    error = 0.05 + (look[:, None] - 1.5 * speed[None, :]) ** 2 / 100.0
    error[look[:, None] < speed[None, :]] = np.nan
    chosen = np.array([0.0, 1.0, 4.0, 5.0]), np.array([3.0, 3.0, 7.0, 7.0])
    return LookAheadSweep(look, speed, error, 10.0 * error, "oscillation (degrees rms)", *chosen, stable_m=speed - 0.5)


def servo_response() -> ServoResponse:
    time = np.arange(0.0, 8.0, 0.02)
    command = np.where(time < 1.0, 0.0, np.where(time < 4.0, 0.1, -0.1))
    return ServoResponse(time, command, command + 0.01, command)


def draw_curve(path: Path, *, force: bool = False) -> None:
    x = np.linspace(0.0, 4.0, 5)
    series = [Points("a", x, 2.0 * x + 0.1, 0.05 + 0.0 * x, 2.0 * x), Points("b", x, 2.0 * x, 0.0 * x, 2.0 * x)]
    curve = Curve("line", x, 2.0 * x, 2.0 * x - 0.2, 2.0 * x + 0.2)
    words = {"title": "t", "x_label": "x (V)", "y_label": "y (m)", "residual_label": "r (mm)", "caption": "said"}
    draw_fitted_curve(series, curve, path, residual_scale=1e3, force=force, **words)


PICTURES: dict[str, Callable[..., None]] = {
    "palm tree": lambda path, force=False: draw_palm_tree(
        [branch(0.1, 5.0), branch(0.0, 0.0), branch(-0.2, -9.0)], path, dropped={"short": 2}, force=force
    ),
    "curve": draw_curve,
    "encoder": lambda path, force=False: draw_encoder_fit(encoder_picture(), path, caption="said.", force=force),
    "encoder in volts": lambda path, force=False: draw_encoder_fit(
        replace(encoder_picture(), v_per_rad=None), path, caption="said.", force=force
    ),
    "look-ahead": lambda path, force=False: draw_look_ahead(sweep(), path, title="t", caption="said.", force=force),
    "look-ahead, nothing stable": lambda path, force=False: draw_look_ahead(
        replace(sweep(), error_m=np.full((9, 5), np.nan), stable_m=np.full(5, np.nan)),
        path,
        title="t",
        caption="said.",
        force=force,
    ),
    "servo": lambda path, force=False: draw_servo_steps(
        servo_response(), path, title="t", caption="said.", force=force
    ),
}


def test_pictures_are_written_whole_and_not_replaced_unasked(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    for name, draw in PICTURES.items():
        path = tmp_path / f"{name}.png"
        draw(path)
        assert imread(path).std() > 0.01
        with refused("output", "--force", file=path):
            draw(path)
    path.write_bytes(b"old")
    draw(path, force=True)
    assert imread(path).std() > 0.01
    assert {each.stem for each in tmp_path.iterdir()} == set(PICTURES)
    assert not caplog.records


def test_an_arc_is_laid_onto_the_positions_that_it_came_from() -> None:
    for curvature in (0.3, 0.0, -1e-9, -0.5):
        one = branch(curvature, 3.0)
        np.testing.assert_allclose(lay_arc(one), np.stack([one.east_m, one.north_m], axis=1), atol=1e-9)
    # A position far off does not pull it.
    one = branch(0.2, 3.0, noise_m=0.02)
    east = one.east_m.copy()
    east[7] += 5.0
    clean, pulled = lay_arc(one), lay_arc(replace(one, east_m=east))
    assert np.max(np.abs(pulled - clean)) < 0.01


def test_palm_tree_colours_by_angle_and_tells_what_was_dropped(tmp_path: Path, drawn: list[Figure]) -> None:
    tree = [branch(0.1, 5.0, noise_m=0.02), branch(0.0, 0.0, noise_m=0.02), branch(-0.2, -9.0, noise_m=0.02)]
    draw_palm_tree(tree, tmp_path / "p.png", dropped={"short": 2, "steering not held": 1})
    axes, bar = drawn[0].axes[:2]
    assert axes.get_aspect() == 1.0
    assert bar.get_ylim() == pytest.approx((-9.0, 5.0))
    np.testing.assert_array_equal(axes.lines[2].get_xdata(), tree[2].east_m)
    colours = {tuple(np.asarray(line.get_color())[:3]) for line in axes.lines[:3]}
    assert len(colours) == 3
    assert {text.get_text() for text in axes.texts} == {"+5°", "0°", "-9°"}
    caption = drawn[0].get_supxlabel().replace("\n", " ")
    assert "2 short, 1 steering not held" in caption
    # Noise of 2 cm to each side: the median distance is 0.6745 of it.
    (off_cm,) = re.findall(r"([\d.]+) cm", caption)
    assert 1.0 < float(off_cm) < 1.7


def test_residuals_are_in_their_own_unit(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_curve(tmp_path / "c.png")
    above, below = drawn[0].axes
    assert above.get_ylabel() == "y (m)"
    assert below.get_ylabel() == "r (mm)"
    bars = below.containers[0].lines[0]  # type: ignore[attr-defined]
    np.testing.assert_allclose(bars.get_ydata(), 100.0)
    low, high = below.get_ylim()
    # The band of 0.2 m to each side is 200 mm here.
    assert low < -200.0 < 200.0 < high


def test_encoder_shows_the_play_as_an_angle(tmp_path: Path, drawn: list[Figure]) -> None:
    draw_encoder_fit(encoder_picture(), tmp_path / "e.png", caption="said.")
    below = drawn[0].axes[1]
    lines = [line for line in below.lines if np.size(line.get_xdata()) == 11]
    levels = sorted(float(np.mean(np.asarray(line.get_ydata()))) for line in lines)
    # 30 counts of play are 5 mV, and 2 V a radian: 0.143 degrees between the lines.
    assert levels[1] - levels[0] == pytest.approx(np.degrees(30.0 / 6000.0 / 2.0), rel=1e-6)
    assert "0.0286" in drawn[0].get_suptitle()


def test_look_ahead_marks_the_least_error_and_what_was_chosen(tmp_path: Path, drawn: list[Figure]) -> None:
    shown = sweep()
    draw_look_ahead(shown, tmp_path / "l.png", title="t", caption="said.")
    left, right = drawn[0].axes[:2]
    chosen, stable, best = left.lines
    expected = [shown.look_ahead_m[np.nanargmin(column)] for column in shown.error_m.T]
    np.testing.assert_array_equal(best.get_ydata(), expected)
    np.testing.assert_array_equal(chosen.get_ydata(), shown.chosen_m)
    np.testing.assert_array_equal(stable.get_ydata(), shown.stable_m)
    assert len(right.lines) == 2
    values: np.ndarray = np.ma.filled(np.ma.asarray(left.collections[0].get_array()), np.nan)
    np.testing.assert_allclose(values.reshape(shown.error_m.shape), 100.0 * shown.error_m)


def test_servo_shows_the_largest_step_close_by(tmp_path: Path, drawn: list[Figure]) -> None:
    response = servo_response()
    unknown = replace(response, command_rad=np.where(response.time_s < 0.1, np.nan, response.command_rad))
    draw_servo_steps(response, tmp_path / "s.png", title="servo", caption="said.")
    draw_servo_steps(unknown, tmp_path / "u.png", title="servo", caption="said.")
    for figure in drawn:
        low, high = figure.axes[1].get_xlim()
        assert low < 4.0 < high
        assert high - low < 3.0
    assert f"{np.degrees(0.01):.2f}°" in drawn[0].get_suptitle()


def test_stability_ends_where_the_margin_is_used_up() -> None:
    look = np.array([1.0, 2.0, 4.0])
    # Crossing half-way between 2 and 4 m; stable throughout; nowhere stable; an unstable island below a stable one.
    margin = np.array([[-2.0, 0.5, -3.0, 0.2], [-1.0, 0.6, -2.0, -1.0], [1.0, 0.7, -1.0, 3.0]])
    np.testing.assert_allclose(stability_limit(look, margin), [3.0, np.nan, np.nan, 2.5])
