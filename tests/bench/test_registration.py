"""The comparison: intervals as SciPy has them, ratios of made-up results, scans in their order."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from matplotlib.image import imread
from scipy.stats import binomtest

from benchmarks import HardSetConfig, PeerResult, make_hard_set, registration, run_peer, wilson
from benchmarks.figure import Point, draw_sweeps
from benchmarks.latency import measure
from benchmarks.peers import PEERS
from benchmarks.peers.worker import Peer
from benchmarks.process import ProgramError
from benchmarks.records import (
    Ran,
    Record,
    Role,
    TileCost,
    equal_success,
    fastest,
    machine_line,
    peer_table,
    peers_as_data,
    ratio_records,
    single,
)
from benchmarks.tracking import latency_records, length_records, tile_cost, tile_records
from refusals import refused

NAN = float("nan")


def ran(role: Role, name: str, setting: str, right: tuple[int, int], times: tuple[float, float, float]) -> Ran:
    """A made-up result; times are single, batch and preparation in milliseconds."""
    single_ms, batch_ms, preparation_ms = times
    result = PeerResult(
        name, setting, right[1], right[0], 0.01, single_ms, batch_ms, 100, preparation_ms, 300.0, 1, 2, ""
    )
    return Ran(role, result)


OURS = ran("ours", "this_project", "columns", (912, 912), (0.5, 0.1, 11.4))
CONTROL = ran("control", "numba_control", "rank 11", (912, 912), (0.2, 0.05, 5.7))
SMALL_SEEDED = ran("seeded", "this_project", "swarm 16x8", (430, 456), (1.0, 1.0, 9.0))
SEEDED = ran("seeded", "this_project", "swarm 24x8", (456, 456), (2.0, 1.5, 9.0))
HASTY = ran("swarm", "numba_swarm", "band 256x40", (440, 456), (2.0, 2.0, 0.0))
GOOD = ran("swarm", "numba_swarm", "band 384x40", (455, 456), (4.0, 6.6, 0.0))
SLOW = ran("swarm", "pyswarms_peer", "band 384x40", (12, 12), (180.0, 180.0, 0.0))
ALL = [OURS, CONTROL, SMALL_SEEDED, SEEDED, HASTY, GOOD, SLOW]


def missing(entry: Ran) -> Ran:
    why = "package numba is not installed"
    nothing = replace(entry.result, problems=0, successes=0, median_error_m=NAN, single_ms=NAN, batch_ms=NAN)
    return Ran(entry.role, replace(nothing, missing=why))


def by_key(records: list[Record]) -> dict[str, Record]:
    found = {record.key: record for record in records}
    assert len(found) == len(records)
    return found


def test_an_interval_is_scipys_and_no_trial_says_nothing() -> None:
    for right, of in ((0, 10), (8, 10), (10, 10), (455, 456), (300, 912)):
        oracle = binomtest(right, of).proportion_ci(method="wilson")
        np.testing.assert_allclose(wilson(right, of), (oracle.low, oracle.high), atol=1e-12)
    assert wilson(0, 0) == (0.0, 1.0)


def test_ratios_compare_with_the_fastest_of_equal_success() -> None:
    records = by_key(ratio_records(ALL, None))
    expected = {
        "success": (100.0, True),
        "batch / best swarm": (6.6 / 0.2, True),
        "batch / best swarm, warm": (66.0, None),
        "batch / PySwarms": (900.0, False),
        "batch / PySwarms, warm": (1800.0, None),
        "single / best swarm": (8.0, False),
        "batch / control": (0.5, False),
        "batch / control, amortised": (0.1 / 0.2, None),
        "single / control": (0.4, False),
        "seeded swarm / Numba swarm, batch": (4.4, True),
        "seeded swarm / Numba swarm, single": (2.0, None),
    }
    assert records.keys() == expected.keys()
    for key, (value, met) in expected.items():
        assert records[key].value == pytest.approx(value), key
        assert records[key].met is met, key
    assert "455 of 456" in records["single / best swarm"].note
    assert "swarm 24x8" in records["seeded swarm / Numba swarm, batch"].note


def test_cold_lines_charge_the_tile_to_this_project() -> None:
    records = by_key(ratio_records(ALL, TileCost(80.0, 34.0)))
    assert records["batch / best swarm, cold"].value == pytest.approx(6.6 / 1.1)
    assert records["single / best swarm, first scan of a tile"].value == pytest.approx(4.0 / 114.5)


def test_a_few_right_of_few_cannot_be_told_from_equal_success() -> None:
    few = ran("swarm", "evosax_peer", "band", (4, 4), (3.0, 3.0, 0.0))
    assert equal_success(few, OURS)
    assert not equal_success(HASTY, OURS)
    assert not equal_success(ran("swarm", "evosax_peer", "band", (5, 8), (1.0, 1.0, 0.0)), OURS)
    assert fastest([HASTY, GOOD, few], OURS, single) is few


def test_a_missing_peer_is_no_ratio_and_no_goal_met() -> None:
    runs = [OURS, missing(CONTROL), missing(SEEDED), missing(GOOD)]
    records = by_key(ratio_records(runs, None))
    for key, record in records.items():
        if key != "success":
            assert math.isnan(record.value), key
            assert record.met is not True, key
    table = peer_table(runs).splitlines()
    assert len(table) == 2 + 3
    assert table[2].startswith("missing: numba_control rank 11: package numba ")
    lines = peer_table(ALL).splitlines()
    assert len(lines) == 1 + len(ALL)
    for value in ("99.6-100.0 %", "0.5 ms (1)", "0.1 ms (2)"):
        assert value in lines[1]
    rows = json.loads(json.dumps(peers_as_data(runs), allow_nan=False))
    assert [row["role"] for row in rows] == ["ours", "control", "seeded", "swarm"]
    assert rows[1]["single_ms"] is None
    assert rows[0]["interval"][1] == 1.0


def test_program_figures_become_records() -> None:
    taken = {"p50_ms": 0.5, "p99_ms": 9.0, "max_ms": 12.0, "preparation_ms": 3.0}
    told = {**taken, "scans": 10_000, "successes": 9_990, "box_m": 0.5}
    one, two = (by_key(latency_records({**told, "threads": threads})) for threads in (1, 2))
    assert one["tracking, 1 core, p99"].met is None
    assert two["tracking, 2 cores, p99"].met is False
    assert "9990 found" in two["tracking, 2 cores, p50"].note
    run = {"scans": 570, "search_m": 3.5, "scans_a_tile": 52.0, "open_s": 0.1, "block_rss_mb": 1.0, "peak_rss_mb": 2.0}
    short = [{**run, "length_m": 1000.0, "scan_ms": scan_ms} for scan_ms in (1.5, 1.0)]
    long = [{**run, "length_m": 1e5, "scan_ms": scan_ms} for scan_ms in (1.08, 1.9)]
    lengths = by_key(length_records(short, long))
    assert lengths["scan on 100 km / on 1 km"].value == pytest.approx(1.08)
    assert lengths["scan on 100 km / on 1 km"].met is True
    assert lengths["scan on 1 km of map"].value == 1.0
    tile = {"gridding_ms": 80.0, "columns_ms": 34.0, "cells": 51200, "search_m": 3.5}
    assert tile_cost(tile) == (80.0, 34.0)
    assert [record.value for record in tile_records(tile)] == [80.0, 34.0]


def test_scans_follow_each_other_and_begin_again() -> None:
    hard_set = make_hard_set(5, HardSetConfig(maps=1, scans=3))
    seen: list[float] = []

    def locate(place: int, samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        assert place == 0
        problem = int(np.flatnonzero([np.array_equal(samples, scan) for scan in hard_set.scans])[0])
        seen.append(problem)
        # The second scan is found half a metre away.
        return np.asarray(hard_set.truth[problem] + np.array([0.5, 0.0, 0.0, 0.0, 0.0]) * (problem == 1))

    taken, successes = measure(hard_set, Peer("fake", "", 1, lambda _: None, locate, None), 7)
    assert seen[-7:] == [0, 1, 2, 0, 1, 2, 0]
    assert successes == 5
    assert taken.shape == (7,)
    assert (taken > 0.0).all()


def test_a_run_gathers_every_program_and_tells_what_failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures: dict[str, dict[str, Any]] = {
        "latency": {"box_m": 0.5, "successes": 9, "p50_ms": 1.0, "p99_ms": 2.0, "max_ms": 3.0, "preparation_ms": 4.0},
        "map_length": {"search_m": 3.5, "gridding_ms": 5.0, "columns_ms": 6.0, "cells": 7},
        "stages": {"whole": 0.5},
    }
    asked: list[tuple[str, ...]] = []

    def program(module: str, arguments: list[str], *, threads: int, **_: object) -> dict[str, Any]:
        name = module.removeprefix("benchmarks.")
        asked.append((name, *arguments))
        if "--kilometres" in arguments:
            raise ProgramError("map_length: broken")
        if name == "latency":
            return {**figures[name], "threads": threads, "scans": 10}
        return figures.get(name, {})

    def peer(name: str, file: Path, *, count: int, options: tuple[str, ...], **_: object) -> PeerResult:
        assert file.exists()
        return replace(GOOD.result, name=name, setting=" ".join(options), problems=count, successes=count)

    monkeypatch.setattr(registration, "run_program", program)
    monkeypatch.setattr(registration, "run_peer", peer)
    plan = replace(registration.FULL, hard_set=HardSetConfig(maps=1, scans=1))
    outcome = registration.run_registration(plan, tmp_path, lambda _: None)
    assert [entry.role for entry in outcome.peers] == [asked_for.role for asked_for in plan.peers]
    assert outcome.not_measured == ["map_length: broken"] * 6
    records = by_key(outcome.records)
    assert records["tracking, 2 cores, p99"].value == 2.0
    # All peers are alike here: the tile alone makes this project slower.
    assert records["batch / best swarm, cold"].value == pytest.approx(6.6 / (6.6 + 11.0 / 114))
    assert records["stage, batch: whole"].value == 0.5
    assert [call for call in asked if call[0] == "stages" and "--batch" in call]
    assert not [key for key in records if key.startswith("accelerator")]


def test_a_missing_package_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(PEERS, "numba_swarm", "no_such_package")
    result = run_peer("numba_swarm", tmp_path / "none.npz", count=1)
    assert "no_such_package" in result.missing
    assert result.problems == 0
    assert math.isnan(result.single_ms)
    assert math.isnan(result.success_share)


def test_the_machine_is_told_in_a_line() -> None:
    line = machine_line()
    assert "\n" not in line
    for word in ("cores", "Python 3.", "numpy 2", "jax 0.", "numba "):
        assert word in line


def test_a_figure_is_drawn_and_not_over_another(tmp_path: Path) -> None:
    strides = [Point(0.12, OURS.result), Point(0.3, HASTY.result), Point(0.4, missing(GOOD).result)]
    grounds = [Point(0.06, HASTY.result), Point(0.12, OURS.result)]
    path = tmp_path / "figure.png"
    draw_sweeps(strides, grounds, path, usual_m=0.12)
    assert imread(path).std() > 0.01
    with refused("output", "--force", file=path):
        draw_sweeps(strides, grounds, path, usual_m=0.12)
