"""Lines by Maxwell's equations: the solver against what is known in closed form, and registering what it computes."""

import math
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from validation.worlds import full_wave
from validation.worlds.full_wave import (
    AIR_WAVELENGTH,
    DAYS,
    GROUNDS,
    figures_of,
    line_figures,
    map_line,
    simulate,
    write_line,
)

ROWS, COLUMNS = 157, 176
SOURCE = (40, 85)
COURANT = 0.7


def line_source(away_cells: float, index: float, steps: int) -> np.ndarray:
    """Field of a current along an endless line, a Ricker pulse, in a uniform medium: closed form, no scale.

    E(t) is minus the derivative of the integral of I(t - t') / sqrt(t'^2 - d^2) over t' > d, d being the travel time;
    t' = d cosh(u) takes the singularity away.
    """
    late = away_cells * index
    time = np.arange(1.0, steps + 1.0) * COURANT
    u = np.linspace(0.0, np.arccosh(time[-1] / late + 1.0), 4000)
    a = (time[:, None] - 0.5 * COURANT - late * np.cosh(u)) / AIR_WAVELENGTH
    p = math.pi * (a - 1.5)
    slope = math.pi / AIR_WAVELENGTH * (4.0 * p**3 - 6.0 * p) * np.exp(-(p**2))
    return np.asarray(-np.trapezoid(np.where(a > 0.0, slope, 0.0), u, axis=1))


def test_direct_wave_and_echo_are_those_of_the_closed_form() -> None:
    """A mirror is a second antenna as far behind it, of the opposite sign; the direct wave sets the scale."""
    above, depth, steps = 4.0, 45, 540
    ground = np.full((1, ROWS, COLUMNS), above, np.float32)
    lossless = jnp.zeros(ground.shape)
    direct = np.asarray(simulate(jnp.asarray(ground), lossless, SOURCE, steps=steps))[0]
    ground[:, SOURCE[0] + depth :] = 1e8
    echo = np.asarray(simulate(jnp.asarray(ground), lossless, SOURCE, steps=steps))[0] - direct
    index = math.sqrt(above)
    expected = line_source(full_wave._APART, index, steps)
    scale = float(direct @ expected / (expected @ expected))
    assert np.abs(direct - scale * expected).max() < 0.02 * np.abs(direct).max()
    mirrored = -scale * line_source(math.hypot(2.0 * depth, full_wave._APART), index, steps)
    # Over 90 cells the grid delays the pulse's upper frequencies a little.
    assert np.abs(echo - mirrored).max() < 0.1 * np.abs(echo).max()


def test_the_border_sends_nothing_back() -> None:
    """The same antenna in a domain that is wider, until what a border returned would have arrived."""
    wide = np.full((1, ROWS, 3 * COLUMNS), 5.0, np.float32)
    near = np.asarray(simulate(jnp.asarray(wide[:, :, :COLUMNS]), jnp.zeros((1, ROWS, COLUMNS)), SOURCE, steps=700))
    far = np.asarray(simulate(jnp.asarray(wide), jnp.zeros(wide.shape), (SOURCE[0], SOURCE[1] + COLUMNS), steps=700))
    assert np.abs(near - far).max() < 0.01 * np.abs(far).max()


def test_one_line_of_one_antenna_is_found_wherever_the_prior_is_beside_it(tmp_path: Path) -> None:
    """Steps across are half as wide as the line: the prior may lie between any two."""
    seed = 2
    map_path = map_line(seed, tmp_path)
    for across_m in (0.0, 0.1, -0.85):
        path = tmp_path / f"beside{across_m}.drive.h5"
        write_line(path, seed, DAYS["clear"], is_map=False, off_m=(0.6, across_m))
        row = figures_of(map_path, path, seed, "clear")
        assert row.ok >= 0.98 * row.scans, across_m
        assert not row.wrong, across_m


@pytest.mark.parametrize("seed", GROUNDS)
def test_every_day_of_every_ground(seed: int, tmp_path: Path) -> None:
    for row in line_figures(seed, tmp_path):
        assert not row.wrong, row
        if row.day != "impostor":
            assert row.ok >= 0.95 * row.scans, row
