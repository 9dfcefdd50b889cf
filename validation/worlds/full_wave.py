"""Lines by Maxwell's equations: ``python -m validation.worlds.full_wave`` (``PYTHONPATH=.:tests``).

Every other ground of these tests adds up single echoes. Here a field in two dimensions (Ey, Hx, Hz on Yee's grid) runs
through soil, so that echoes are shadowed, scattered again and dispersed in time, the direct wave changes with the soil
below the antenna, and a wetter day is another permittivity and no stretched recording. One antenna on one line: the map
is one pass, a day's drive another one along it, between its places, with GNSS that is off. Lengths scale with the
wavelength, so that one compiled program serves all bands.
"""

import argparse
import math
import sys
import tempfile
from collections.abc import Iterator
from functools import lru_cache, partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.ndimage import gaussian_filter

from benchmarks.page import condition_table
from benchmarks.records import Record, kept_text
from lgprjax.batch import register_log
from lgprjax.formats import DriveDescription, DriveLog, DriveWriter, MapFile, NavigationTrack, OdometryTrack
from lgprjax.formats import TraceRecording as Traces
from lgprjax.mapping import build_map
from lgprjax.radar import ArrayGeometry
from lgprjax.registration import RegisterOptions

LIGHT_M_PER_NS = 0.299792458

# In cells: a twentieth of the wavelength in air at the centre frequency, about seven in wet soil.
AIR_WAVELENGTH = 60.0
_WIDTH, _DEPTH, _AIR, _SPONGE = 176, 132, 22, 16
_ABOVE, _APART, _SPACING = 3, 6, 2
_STEPS, _EVERY = 1100, 5
TRACES = 360


class FullWaveDay(NamedTuple):
    """What differs from the day of the map.

    Attributes:
        wetter: factor of the soil's permittivity; top: another one of its uppermost sixth of a wavelength.
        snow: thickness in cells, below the antenna, which rides upon it.
        noise: RMS over that of the ground's echoes in the later half of a trace.
        other: another ground below the same drive.
    """

    wetter: float = 1.0
    top: float = 1.0
    snow: int = 0
    noise: float = 0.15
    other: bool = False


DAYS = {
    "clear": FullWaveDay(),
    "wet": FullWaveDay(wetter=1.10, top=1.15, noise=0.2),
    "snow": FullWaveDay(snow=6, noise=0.25),
    "impostor": FullWaveDay(other=True),
}
GROUNDS = {0: 150.0, 1: 270.0, 2: 420.0}
"""Centre frequencies in MHz, by seed."""


def cell_m(centre_mhz: float) -> float:
    """Edge of a cell."""
    return LIGHT_M_PER_NS * 1e3 / centre_mhz / AIR_WAVELENGTH


@partial(jax.jit, static_argnames="steps")
def simulate(
    permittivity: Float[Array, "trace z x"], loss: Float[Array, "trace z x"], source: tuple[int, int], *, steps: int
) -> Float[Array, "trace step"]:
    """The field at the receiver, ``_APART`` cells beside the source, at every step of 0.7 cells over light's speed.

    Args:
        permittivity: relative.
        loss: conductivity times impedance of free space times the cell, no unit.
        source: cell (z, x).
        steps: of time.
    """
    courant = 0.7
    ramp = jnp.arange(_SPONGE, 0, -1, dtype=jnp.float32) / _SPONGE
    sides = jnp.zeros(permittivity.shape[-1]).at[:_SPONGE].set(ramp).at[-_SPONGE:].set(ramp[::-1])
    ends = jnp.zeros(permittivity.shape[-2]).at[:_SPONGE].set(ramp).at[-_SPONGE:].set(ramp[::-1])
    # Electric and magnetic loss in proportion: the border's impedance is the soil's, and nothing is reflected.
    sponge = 0.8 * (jnp.maximum(sides[None, :], ends[:, None]) ** 3)[None]
    per_step = 0.5 * courant * (loss / permittivity + sponge)
    electric_keep, electric_gain = (1.0 - per_step) / (1.0 + per_step), courant / permittivity / (1.0 + per_step)
    magnetic = 0.5 * courant * sponge
    keep, gain = (1.0 - magnetic) / (1.0 + magnetic), courant / (1.0 + magnetic)
    period = AIR_WAVELENGTH / courant

    def step(fields: tuple[Array, Array, Array], number: Array) -> tuple[tuple[Array, Array, Array], Array]:
        e, hx, hz = fields
        hx = keep[:, :-1] * hx + gain[:, :-1] * (e[:, 1:] - e[:, :-1])
        hz = keep[:, :, :-1] * hz - gain[:, :, :-1] * (e[:, :, 1:] - e[:, :, :-1])
        curl = (hx[:, 1:, 1:-1] - hx[:, :-1, 1:-1]) - (hz[:, 1:-1, 1:] - hz[:, 1:-1, :-1])
        inner = (slice(None), slice(1, -1), slice(1, -1))
        e = e.at[inner].set(electric_keep[inner] * e[inner] + electric_gain[inner] * curl)
        late = (number / period - 1.5) * math.pi
        ricker = (1.0 - 2.0 * late**2) * jnp.exp(-(late**2))
        e = e.at[:, source[0], source[1]].add(-ricker)
        return (e, hx, hz), e[:, source[0], source[1] + _APART]

    traces, rows, columns = permittivity.shape
    still = (
        jnp.zeros((traces, rows, columns)),
        jnp.zeros((traces, rows - 1, columns)),
        jnp.zeros((traces, rows, columns - 1)),
    )
    _, seen = jax.lax.scan(step, still, jnp.arange(steps, dtype=jnp.float32))
    return seen.T


class Soil(NamedTuple):
    """A ground in cells, its surface at row 0 on average.

    Attributes:
        permittivity: relative; loss: as in ``simulate``; surface: height of the soil above row 0, cells.
    """

    permittivity: Float[np.ndarray, "z x"]
    loss: Float[np.ndarray, "z x"]
    surface: Float[np.ndarray, " x"]


def make_soil(seed: int) -> Soil:
    """Layers that undulate, a texture, and stones, some of them in each other's shadow."""
    rng = np.random.default_rng([91, seed])
    columns, rows = TRACES * _SPACING + 2 * _WIDTH, _DEPTH

    def waves(length: float, height: float) -> np.ndarray:
        drawn = gaussian_filter(rng.standard_normal(columns + 400), length)[200:-200]
        return np.asarray(height * drawn / drawn.std())

    depth = np.arange(rows)[:, None]
    base = rng.uniform(6.0, 9.0)
    permittivity = np.full((rows, columns), base)
    for at in (rng.uniform(12, 25), rng.uniform(45, 70)):
        below = depth > at + waves(rng.uniform(30, 90), rng.uniform(2, 5))
        permittivity = np.where(below, permittivity + rng.uniform(-1.5, 2.5), permittivity)
    texture = gaussian_filter(rng.standard_normal(permittivity.shape), (3.0, rng.uniform(5.0, 12.0)))
    permittivity += rng.uniform(0.3, 0.6) * texture / texture.std()
    for _ in range(round(columns / 7)):
        z, x, high, wide = rng.uniform(4, rows), rng.uniform(0, columns), rng.uniform(1.0, 3.5), rng.uniform(1.0, 5.0)
        inside = ((depth - z) / high) ** 2 + ((np.arange(columns) - x) / wide) ** 2 < 1.0
        permittivity[inside] = rng.choice([4.5, 5.5, 14.0])
    loss = np.full(permittivity.shape, rng.uniform(0.02, 0.05))
    return Soil(np.maximum(permittivity, 3.0), loss, waves(12.0, 0.4))


def _windows(soil: Soil, day: FullWaveDay, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Permittivity and loss about every place of the antenna: air, snow, soil."""
    rows = np.arange(_DEPTH + _AIR + _ABOVE)[:, None] - (_AIR + _ABOVE)
    share = np.clip(rows + 0.5 + soil.surface[None, :], 0.0, 1.0)  # of the cell that is soil
    below = np.concatenate([np.repeat(soil.permittivity[:1], _AIR + _ABOVE, axis=0), soil.permittivity])
    wet = below * day.wetter * np.where(rows < AIR_WAVELENGTH / 6.0, day.top, 1.0)
    snow = np.where(rows >= -day.snow, 1.5, 1.0)
    permittivity = share * wet + (1.0 - share) * snow
    lost = share * soil.loss[0] * day.wetter**2
    of = starts[:, None] + np.arange(_WIDTH)
    return permittivity[:, of].transpose(1, 0, 2), np.broadcast_to(lost, permittivity.shape)[:, of].transpose(1, 0, 2)


@lru_cache(maxsize=2)
def line_of(seed: int, day: FullWaveDay, offset: int, block: int = 24) -> Float[np.ndarray, "trace sample"]:
    """The traces of a pass whose antenna begins ``offset`` cells along."""
    soil = make_soil(seed + 50 * day.other)
    starts = offset + _SPACING * np.arange(TRACES)
    source = (_AIR - day.snow, (_WIDTH - _APART) // 2)
    found = []
    for first in range(0, TRACES, block):
        permittivity, loss = _windows(soil, day, starts[first : first + block])
        seen = simulate(jnp.asarray(permittivity, jnp.float32), jnp.asarray(loss, jnp.float32), source, steps=_STEPS)
        found.append(np.asarray(seen[:, ::_EVERY]))
    return np.concatenate(found)


def write_line(
    path: Path, seed: int, day: FullWaveDay, *, is_map: bool, off_m: tuple[float, float] | None = None
) -> None:
    """A pass as a drive log: the map's with places that are known, a day's with GNSS that is off and does not say so.

    Args:
        path: the log.
        seed, day: which.
        is_map: the map's pass.
        off_m: by which GNSS is off, east (along) and north (across); drawn where not given.
    """
    centre_mhz = GROUNDS[seed]
    cell, rng = cell_m(centre_mhz), np.random.default_rng([92, seed, is_map, *map(ord, path.name)])
    offset = 40 if is_map else 40 + _SPACING // 2
    traces = line_of(seed, day, offset)
    late = traces[:, traces.shape[1] // 2 :]
    noise = day.noise * np.std(late - late.mean(axis=0))
    traces = traces + noise * rng.standard_normal(traces.shape)
    # A receiver's gain over time, without which the direct wave takes all its levels.
    traces = traces * (1.0 + (np.arange(traces.shape[1]) / 40.0) ** 2)
    stored = np.clip(np.round(traces * 20000.0 / np.quantile(np.abs(traces), 0.999)), -32767, 32767).astype(np.int16)
    at_m = cell * (offset + _SPACING * np.arange(TRACES))
    time_s = at_m - at_m[0]  # at 1 m/s
    if off_m is None:
        off_m = (0.0, 0.0) if is_map else (rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0))
    clock_s = np.arange(0.0, time_s[-1] + 0.2, 0.1)
    size = len(clock_s)
    along = at_m[0] + clock_s
    metre_deg = 1.0 / 111_320.0

    def track(east_m: np.ndarray, north_m: np.ndarray, sigma_m: float | None) -> NavigationTrack:
        stated = None if sigma_m is None else np.full(size, sigma_m)
        zero = np.zeros(size)
        return NavigationTrack(
            clock_s, north_m * metre_deg, east_m * metre_deg, zero, np.full(size, 90.0), zero,
            sigma_east_m=stated, sigma_north_m=stated,
        )  # fmt: skip

    interval_ns = _EVERY * 0.7 * cell / LIGHT_M_PER_NS
    description = DriveDescription(
        name=path.name.split(".")[0],
        t0_utc=f"2024-06-{1 if is_map else 11:02d}T08:00:00Z",
        array=ArrayGeometry(np.zeros(1), np.zeros(1), np.zeros(1), cell * _ABOVE),
        recording=Traces(
            sample_interval_ns=interval_ns,
            time_zero_ns=1.5e3 / centre_mhz,
            zero_level=0.0,
            centre_frequency_hz=1e6 * centre_mhz,
            samples=stored.shape[1],
        ),
        navigation=track(along + off_m[0], np.full(size, off_m[1]), 0.02 if is_map else None),
        odometry=OdometryTrack(clock_s, np.floor(clock_s * (1.0 if is_map else 1.004) / 0.005) * 0.005),
        truth=track(along, np.zeros(size), None),
        vehicle=None,
        provenance={"program": "validation/worlds/full_wave", "ground": seed},
    )
    with DriveWriter.create(path, description, channels=1, dtype=np.dtype(np.int16), force=True) as log:
        log.append(time_s, stored[:, None, :])


class LineFigures(NamedTuple):
    """One day of a line: scans after the first four metres, those that are ok, of them wrong by over 0.3 m; metres."""

    ground: int
    day: str
    scans: int
    ok: int
    wrong: int
    rms_along_m: float
    largest_m: float


def map_line(seed: int, folder: Path) -> Path:
    """The map of one pass of a ground."""
    path = folder / "line.map.h5"
    write_line(folder / "map.drive.h5", seed, FullWaveDay(), is_map=True)
    build_map([folder / "map.drive.h5"], path, force=True)
    return path


def figures_of(map_path: Path, path: Path, seed: int, day: str) -> LineFigures:
    """Register a day's drive, everything by default."""
    with MapFile.open(map_path) as source, DriveLog.open(path) as log:
        registered = register_log(source, log, RegisterOptions())
    assert registered.truth is not None
    along = np.asarray(registered.fix.pose)[:, 0] - registered.truth[:, 0]
    counts = np.arange(TRACES) * _SPACING * cell_m(GROUNDS[seed]) >= 4.0
    ok = counts & (registered.table["code"].to_numpy() == "ok")
    wrong = ok if DAYS[day].other else ok & ~(np.abs(along) <= 0.3)
    largest = float(np.abs(along[ok]).max()) if ok.any() else math.nan
    rms = float(np.sqrt(np.mean(along[ok] ** 2))) if ok.any() else math.nan
    return LineFigures(seed, day, int(counts.sum()), int(ok.sum()), int(wrong.sum()), rms, largest)


def line_figures(seed: int, folder: Path) -> Iterator[LineFigures]:
    """Map one pass of a ground and register every day on it."""
    map_path = map_line(seed, folder)
    for name, day in DAYS.items():
        path = folder / f"{name}.drive.h5"
        write_line(path, seed, day, is_map=False)
        yield figures_of(map_path, path, seed, name)


def records_of(row: LineFigures) -> list[Record]:
    """Of a day of a line: nothing wrong is asked, and of other ground nothing ``ok``."""
    key, other = f"{row.ground}, {GROUNDS[row.ground]:.0f} MHz, {row.day}", DAYS[row.day].other
    share = 100.0 * row.ok / row.scans
    return [
        Record(f"{key}: scans", row.scans, "", "higher"),
        Record(f"{key}: `ok`", share, "%", "lower" if other else "higher", 0.0 if other else None),
        Record(f"{key}: wrong by over 0.3 m", row.wrong, "", "lower", 0.0),
        Record(f"{key}: along, RMS", 100.0 * row.rms_along_m, "cm", "lower"),
        Record(f"{key}: along, largest", 100.0 * row.largest_m, "cm", "lower"),
    ]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="validation.worlds.full_wave")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure")
    chosen = parser.parse_args()
    records: list[Record] = []
    for seed in GROUNDS:
        with tempfile.TemporaryDirectory() as folder:
            for row in line_figures(seed, Path(folder)):
                records += records_of(row)
    print(condition_table(records))
    if chosen.json:
        chosen.json.write_text(kept_text("python -m validation.worlds.full_wave", records), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
