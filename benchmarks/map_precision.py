"""What the precision of a map's traces costs in bytes, and what it does to fixes: one table.

A program (``python -m benchmarks.map_precision OUT.jsonl``). Generated roads, each with two baselines, live drives
of two days with GNSS wrong by a metre, and an impostor: the same drive over other ground. The map is built once with
samples of 16 bits and coded anew with every step; all drives are registered on every map.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from benchmarks.records import Interval, wilson
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import MAP_PRECISIONS, DriveLog, MapFile, MapPrecision, MapWriter
from lgprjax.formats.map_layout import PLACE_UNITS
from lgprjax.mapping import build_map
from lgprjax.registration import WRONG_M, Code, RegisterOptions
from lgprjax.scene import WEATHER, DrivePlan, GroundConfig, NavigationErrors, make_ground, simulate_drive
from lgprjax.simulation import write_drive
from lgprjax.subsurface import StationBlock

STEPS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0)
"""Of rounding, in RMS values."""
DAYS = ("clear", "snow")
IMPOSTOR = "impostor"
_OPTIONS = RegisterOptions(search_m=1.5)
_SURVEY = NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=float(np.radians(0.1)))
_METRE_OFF = NavigationErrors(position_bias_m=(0.8, 0.6))
_STATIONS = 1024
_DRAWS = 1000
_BLOCK_SCANS = 28  # a metre: errors of neighbouring scans are alike


class Outcome(NamedTuple):
    """Live drives on maps of one precision.

    Attributes:
        error_m: horizontal, of every scan.
        ok: scans called ok.
        false_ok: scans of impostors called ok.
        impostor: their number.
    """

    error_m: Float[np.ndarray, " scan"]
    ok: Bool[np.ndarray, " scan"]
    false_ok: int
    impostor: int


class Size(NamedTuple):
    """Of a map: metres of lane, bytes in all and of traces, bits a number of a trace, correlation with float16."""

    length_m: float
    bytes: int
    trace_bytes: int
    numbers: int
    correlation: float


def render(folder: Path, seed: int, length_m: float) -> dict[str, Path]:
    """Baselines, live drives of each day and an impostor, by name."""
    ground = make_ground(seed, GroundConfig(length_m=length_m))
    other = make_ground(seed + 1000, GroundConfig(length_m=length_m))
    live = DrivePlan(5.0, length_m - 10.0, lane_m=0.2)
    drives = {
        f"baseline_{number}": simulate_drive(
            ground, DrivePlan(0.0, length_m - 5.0, lane_m=lane_m), WEATHER["clear"](number), number, errors=_SURVEY
        )
        for number, lane_m in ((1, 0.3), (2, -0.3))
    }
    for number, day in enumerate(DAYS):
        drives[day] = simulate_drive(ground, live, WEATHER[day](10 + number), 3, errors=_METRE_OFF)
    drives[IMPOSTOR] = simulate_drive(other, live, WEATHER["clear"](20), 3, errors=_METRE_OFF)
    paths = {name: folder / f"{name}.drive.h5" for name in drives}
    for name, drive in drives.items():
        write_drive(paths[name], drive)
    return paths


def recode(source: MapFile, path: Path, precision: MapPrecision) -> None:
    """Write a map's stations with another precision; from samples of 16 bits they are as if built so."""
    with MapWriter.create(path, precision=precision) as writer:
        for start in range(0, len(source.places), _STATIONS):
            chosen = np.arange(start, min(start + _STATIONS, len(source.places)))
            read, where = source.read_stations(chosen), source.places.read(chosen)
            time_s = PLACE_UNITS[7] * source.read_stored(chosen).place[:, 7]
            for drive in np.unique(where.drive):
                own = where.drive == drive
                block = (read.profile, read.valid, where.pose, where.ground_up_m, read.antenna_m, time_s)
                writer.append(StationBlock(*(field[own] for field in block)), int(drive))
        writer.finish(source.description, source.tile_frame, source.height_reference_m, source.provenance)


def size_of(path: Path, original: Path) -> Size:
    """Bytes of a map, and how like its gained traces are those of the original."""
    with MapFile.open(path) as coded, MapFile.open(original) as source:
        stations = np.arange(len(coded.places))
        gain = source.description.gain
        a, b = (file.read_stations(stations).profile * gain for file in (coded, source))
        step_m = np.hypot(*np.diff(coded.pose[:, :2], axis=0).T)[np.diff(coded.drive) == 0]
        correlation = float(np.sum(a * b, dtype=np.float64) / np.sqrt(np.sum(a**2) * np.sum(b**2)))
        traces = coded.stored_bytes()["traces"]
        return Size(float(step_m.sum()), path.stat().st_size, traces, a.size, correlation)


def outcome_of(drives: Sequence[RegisteredDrive], impostors: Sequence[RegisteredDrive]) -> Outcome:
    """All drives together."""
    errors, ok = [], []
    for drive in drives:
        assert drive.truth is not None
        errors.append(np.hypot(*(np.asarray(drive.fix.pose)[:, :2] - drive.truth[:, :2]).T))
        ok.append(np.asarray(drive.fix.code) == Code.OK)
    false = [np.asarray(drive.fix.code) == Code.OK for drive in impostors]
    return Outcome(
        np.concatenate(errors), np.concatenate(ok), int(sum(f.sum() for f in false)), sum(len(f) for f in false)
    )


def ratio_of(found: Outcome, full: Outcome, rng: np.random.Generator) -> Interval:
    """95 % interval of the ratio of RMS errors of ok fixes, the same stretches of road on both maps."""
    blocks = -(-len(full.ok) // _BLOCK_SCANS)
    member = np.arange(len(full.ok)) // _BLOCK_SCANS

    def sums(outcome: Outcome) -> tuple[np.ndarray, np.ndarray]:
        squares = np.where(outcome.ok, outcome.error_m**2, 0.0)
        return np.bincount(member, squares, blocks), np.bincount(member, outcome.ok, blocks)

    drawn = rng.integers(0, blocks, (_DRAWS, blocks))
    rms = [
        np.sqrt(squares[drawn].sum(axis=1) / np.maximum(count[drawn].sum(axis=1), 1))
        for squares, count in (sums(found), sums(full))
    ]
    low, high = np.percentile(rms[0] / rms[1], [2.5, 97.5])
    return Interval(float(low), float(high))


def row_of(name: str, sizes: Sequence[Size], found: Outcome, full: Outcome) -> dict[str, object]:
    """A line of the table."""
    length_m = sum(size.length_m for size in sizes)
    error_m, reference_m = found.error_m[found.ok], full.error_m[full.ok]
    ratio = ratio_of(found, full, np.random.default_rng(0))
    available = wilson(int(found.ok.sum()), len(found.ok))
    rms, reference = (float(np.sqrt(np.mean(errors**2))) for errors in (error_m, reference_m))
    return {
        "precision": name,
        "bytes_per_m": round(sum(size.bytes for size in sizes) / length_m),
        "trace_bytes_per_m": round(sum(size.trace_bytes for size in sizes) / length_m),
        "bits_a_number": round(8 * sum(size.trace_bytes for size in sizes) / sum(size.numbers for size in sizes), 2),
        "correlation": round(float(np.mean([size.correlation for size in sizes])), 4),
        "median_m": round(float(np.median(error_m)), 5),
        "rms_m": round(rms, 5),
        "rms_ratio": round(rms / reference, 4),
        "rms_ratio_95": [round(ratio.low, 4), round(ratio.high, 4)],
        "ok": round(float(found.ok.mean()), 4),
        "ok_95": [round(available.low, 4), round(available.high, 4)],
        "scans": len(found.ok),
        "wrong_ok": int(np.sum(error_m > WRONG_M)),
        "impostor_ok": found.false_ok,
        "impostor_scans": found.impostor,
    }


def measure(folder: Path, seeds: Sequence[int], length_m: float, steps: Sequence[float]) -> list[dict[str, object]]:
    """The table.

    Args:
        folder: for maps and drives.
        seeds: of the roads.
        length_m: of each.
        steps: besides samples of 16 bits, which come first.
    """
    precisions = [MAP_PRECISIONS["full"], *(MapPrecision(f"step {step:g}", step) for step in steps)]
    live: dict[str, list[RegisteredDrive]] = {precision.name: [] for precision in precisions}
    false: dict[str, list[RegisteredDrive]] = {precision.name: [] for precision in precisions}
    sizes: dict[str, list[Size]] = {precision.name: [] for precision in precisions}
    for seed in seeds:
        here = folder / str(seed)
        here.mkdir()
        paths = render(here, seed, length_m)
        full = here / "full.map.h5"
        build_map([paths["baseline_1"], paths["baseline_2"]], full, precision=precisions[0])
        for number, precision in enumerate(precisions):
            path = full
            if number:
                path = here / f"{number}.map.h5"
                with MapFile.open(full) as source:
                    recode(source, path, precision)
            sizes[precision.name].append(size_of(path, full))
            with MapFile.open(path) as source:
                for name in (*DAYS, IMPOSTOR):
                    with DriveLog.open(paths[name]) as log:
                        kind = false if name == IMPOSTOR else live
                        kind[precision.name].append(register_log(source, log, _OPTIONS))
    outcomes = {name: outcome_of(live[name], false[name]) for name in live}
    return [row_of(name, sizes[name], outcomes[name], outcomes["full"]) for name in live]


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.map_precision")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--length-m", type=float, default=80.0)
    parser.add_argument("--steps", type=float, nargs="+", default=STEPS)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        table = measure(Path(folder), chosen.seeds, chosen.length_m, chosen.steps)
    chosen.out.write_text("".join(json.dumps(row) + "\n" for row in table), encoding="utf-8")
    print(chosen.out.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
