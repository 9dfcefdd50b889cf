"""A drive recorded by hand becomes map and route of a drive by LGPR in snow; its drive log, its replay."""

import json
import re
import sys
from functools import partial
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from canon.commands import Done, run, succeed
from canon.map import of_many_grounds
from canon.record import record
from cli.processes import ROOT, lgprjax, quick
from lgprjax.cli.simulated_run import _SHOWN
from lgprjax.formats import VehicleLog
from lgprjax.mapping import build_map
from lgprjax.process_cost import count_compiles


class Driven(NamedTuple):
    """A run: its folder, what the command said, the file of its figures."""

    folder: Path
    done: Done
    figures: Path


def write_course(folder: Path) -> Path:
    """A configuration of a short course with a third of the scans; its map and route come from a drive by hand.

    The map's chance is the pooled one of many grounds: measuring its own takes longer than the run.
    """
    recorded = record(folder / "first", 30.0, ("scan_share = 6", "scan_share = 3"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lgprjax.mapping.build_map", partial(build_map, measure=of_many_grounds))
        succeed("map", "build", recorded.folder, "-o", folder / "first.map.h5")
    vehicle = ROOT / "onboard" / "made_up.vehicle.toml"
    words = ("route", "select", folder / "first.map.h5", "record", "--vehicle", vehicle)
    succeed(*words, "-o", folder / "first.route.toml")
    text = (ROOT / "onboard" / "simulated.run.toml").read_text(encoding="utf-8")
    text = text.replace("length_m = 300.0", 'length_m = 60.0\nscan_share = 3\nweather = "snow"')
    return quick(text.replace("course300", "first"), folder / "short.run.toml")


@pytest.fixture(scope="module")
def course(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The configuration, in a folder of its own."""
    return write_course(tmp_path_factory.mktemp("run"))


@pytest.fixture(scope="module")
def driven(course: Path) -> Driven:
    """In lock step: on any machine to the end of the way."""
    figures = course.parent / "lockstep.json"
    done = lgprjax("run", str(course), "--simulate", "--lockstep", "--for-s", "90", "--json", str(figures))
    assert done.status == 0, done.out[-2000:] + done.err[-4000:]
    return Driven(next((course.parent / "runs").iterdir()), done, figures)


def test_in_lock_step_it_arrives_on_any_machine_and_tells_its_course(driven: Driven) -> None:
    found = json.loads(driven.figures.read_text(encoding="utf-8"))
    assert found["tracking_rms_m"] < 0.15
    assert found["period_largest_ms"] == pytest.approx(20.0, abs=0.1)
    # Every figure stands in the table, in words and with its unit.
    assert set(found) <= {name for *_, names in _SHOWN for name in names} | {"modes"}
    assert re.search(r"│ [0-9.]+ cm, [0-9.]+ cm", driven.done.out)
    line = json.loads(succeed("events", driven.folder, "--json", "-"))
    assert (line["engaged"], line["arrived"], line["shortfall"], line["end"]) == (True, True, None, "ended")
    modes = [event["mode"] for event in line["events"] if event["kind"] == "mode"]
    assert modes == ["CHECKS", "READY", "STEERING", "SPEED", "MANUAL"]
    times = [event["time_s"] for event in line["events"]]
    assert times == sorted(times)


def test_a_simulated_run_becomes_a_drive_log(driven: Driven, tmp_path: Path) -> None:
    path = driven.folder / "simulated.drive.h5"
    log = VehicleLog.open(path)
    assert log.vehicle is not None
    assert {"steering_potentiometer_v", "encoder_counts", "throttle", "brake", "mode"} <= set(log.vehicle)
    succeed("check", path)
    assert "ended" in succeed("recover", driven.folder, "-o", tmp_path / "again.drive.h5")


def test_the_run_replays_to_the_same_commands(driven: Driven) -> None:
    config = driven.folder / "simulated.run.toml"
    found = json.loads(succeed("run", config, "--replay", driven.folder, "--json", "-"))
    assert (found["differing"], found["broken"]) == (0, None)
    assert found["frames"] >= found["ticks"] > 300


def test_a_compilation_is_counted() -> None:
    compiles = count_compiles()
    jax.jit(lambda x: x * 3.25 + 1.0)(jnp.arange(3, dtype=jnp.float32))
    assert compiles() >= 1
    before = compiles()
    np.testing.assert_allclose(np.arange(3), np.arange(3))
    assert compiles() == before


def test_a_preflight_names_what_is_not_in_order(course: Path) -> None:
    done = run("run", course, "--preflight")
    assert done.status == 1
    assert "NOT OK" in done.out
    assert "drive_by_wire" in done.out


def test_packages_that_are_missing_are_one_line_before_anything_starts(
    course: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(course.parent.iterdir())
    monkeypatch.setitem(sys.modules, "pyubx2", None)
    done = run("run", course, "--simulate")
    assert done.status == 1
    done.refusal.check(None, "lgprjax[onboard]", found="pyubx2")
    assert sorted(course.parent.iterdir()) == before
