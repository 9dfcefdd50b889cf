"""The swarm's picture: clouds where the particles stood, scores as they were."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from lgprjax.report import SwarmPicture, draw_swarm
from refusals import refused
from report.synthetic import numbers

ITERATIONS, PARTICLES = 24, 9


def swarm(iterations: int = ITERATIONS) -> SwarmPicture:
    """Particles that gather about (0.03, -0.02)."""
    rng = np.random.default_rng(2)
    side = np.linspace(-0.12, 0.12, 25)
    left = 0.8 ** np.arange(iterations + 1)
    place = np.array([0.03, -0.02]) + left[:, None, None] * rng.uniform(-0.1, 0.1, (iterations + 1, PARTICLES, 2))
    score = 0.9 - np.hypot(*(place - [0.03, -0.02]).transpose(2, 0, 1))
    met = np.maximum.accumulate(score, axis=0)
    best = place[np.arange(iterations + 1), np.argmax(score, axis=1)]
    offset = left[:, None, None] * rng.uniform(-1.0, 1.0, (iterations + 1, PARTICLES, 3)) * [0.08, 5.0, 1.5]
    east, north = np.meshgrid(side, side, indexing="ij")
    surface = 0.9 - 4.0 * np.hypot(east - 0.03, north + 0.02)
    surface[0] = np.nan
    return SwarmPicture(
        x_m=side,
        y_m=side,
        score=surface,
        particle_m=place,
        best_m=best,
        offset=offset,
        best_offset=offset[:, 0],
        best_score=met,
        milliseconds=5.67,
        origin="a place",
        truth=(0.03, -0.02),
    )


def test_clouds_stand_where_the_particles_stood(tmp_path: Path, drawn: list[Figure]) -> None:
    shown = swarm()
    draw_swarm(shown, tmp_path / "s.png")
    clouds = [axes for axes in drawn[0].axes if axes.images]
    for axes, moment in zip(clouds, (0, 3, 8, 24), strict=True):
        assert moment == 0 or axes.get_title(loc="left").endswith(f" {moment}")
        particles, truth, best = axes.lines
        np.testing.assert_array_equal(np.stack(particles.get_data(), axis=1), shown.particle_m[moment])
        np.testing.assert_array_equal(np.concatenate(best.get_data()), shown.best_m[moment])
        assert tuple(np.concatenate(truth.get_data())) == shown.truth
        image = axes.images[0]
        np.testing.assert_array_equal(np.ma.filled(np.ma.asarray(image.get_array()), np.nan), shown.score.T)
        assert image.get_clim() == (0.0, 1.0)
        assert axes.get_aspect() == 1.0
    assert numbers(drawn[0].subfigs[0].get_suptitle()) == ["9", "24", "225", "5.67"]
    assert "a place" in drawn[0].get_supxlabel().replace("\n", " ")


def test_height_heading_and_roll_are_shown_as_they_gather(tmp_path: Path, drawn: list[Figure]) -> None:
    shown = swarm()
    draw_swarm(shown, tmp_path / "s.png")
    for axis, label in enumerate(("height (m)", "heading (°)", "roll (°)")):
        axes = next(axes for axes in drawn[0].axes if axes.get_title(loc="left") == label)
        np.testing.assert_array_equal(np.asarray(axes.lines[0].get_ydata()), shown.best_offset[:, axis])
        widest = np.asarray(axes.collections[0].get_paths()[0].vertices)[:, 1]
        assert (widest.min(), widest.max()) == (shown.offset[..., axis].min(), shown.offset[..., axis].max())


def test_scores_are_the_best_and_the_median(tmp_path: Path, drawn: list[Figure]) -> None:
    shown = swarm()
    met = shown.best_score.copy()
    met[0, :5] = -np.inf  # more than half of nine have met nothing yet
    draw_swarm(replace(shown, best_score=met), tmp_path / "s.png")
    axes = next(axes for axes in drawn[0].axes if axes.get_xlabel().startswith("iteration"))
    best, median = (line for line in axes.lines if line.get_label() in ("best", "median"))
    np.testing.assert_array_equal(best.get_ydata(), np.max(met, axis=1))
    np.testing.assert_allclose(np.asarray(median.get_ydata())[1:], np.median(met[1:], axis=1))
    assert np.isnan(np.asarray(median.get_ydata())[0])


def test_short_swarms_and_one_that_met_nothing_draw(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, drawn: list[Figure]
) -> None:
    for iterations in (0, 1, 3):
        draw_swarm(swarm(iterations), tmp_path / f"{iterations}.png")
        assert len([axes for axes in drawn[-1].axes if axes.images]) == len({0, round(iterations / 3), iterations})
    shown = swarm(3)
    nothing: dict[str, Any] = {
        "best_score": np.full_like(shown.best_score, -np.inf),
        "score": np.full_like(shown.score, np.nan),
    }
    draw_swarm(replace(shown, **nothing, truth=None), tmp_path / "s.png")
    assert not caplog.records
    with refused("output", "--force", file="s.png"):
        draw_swarm(shown, tmp_path / "s.png")
