"""A whole first day on 60 m with a hidden vehicle, by verbs alone; its drive by LGPR as drive log and replay."""

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from canon.calibration import KIT_FILE, SHORT
from canon.commands import run, succeed
from canon.first_day import first_day, wrong_fixes
from canon.map import built_with_many_grounds
from canon.shared import shared_folder
from lgprjax.cli.run import _SHOWN
from lgprjax.formats import VehicleLog
from lgprjax.machine import count_compiles


class Driven(NamedTuple):
    """A run: its folder, what the command said, its figures."""

    folder: Path
    said: str
    figures: dict[str, Any]


def driven_of(folder: Path, name: str) -> Driven:
    """A drive of the day."""
    (run_folder,) = (folder / name).iterdir()
    figures = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return Driven(run_folder, (folder / f"{name}.said").read_text(encoding="utf-8"), figures)


@pytest.fixture(scope="module")
def day(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of the day, and nothing else.

    The map's chance is the pooled one of many grounds: measuring its own takes longer than the runs.
    """

    def make(folder: Path) -> None:
        with built_with_many_grounds():
            first_day(folder, SHORT, 60.0, calibrate=lambda to: shutil.copy(KIT_FILE, to / "kit.vehicle.toml"))

    return shared_folder(tmp_path_factory, "first_day", make)


@pytest.fixture(scope="module")
def course(day: Path) -> Path:
    """The configuration of the drive by LGPR."""
    return day / "evening.run.toml"


@pytest.fixture(scope="module")
def driven(day: Path) -> Driven:
    """The drive by LGPR in snow; the GNSS line fell silent in it."""
    return driven_of(day, "evening")


def test_the_day_ends_with_a_drive_by_the_ground_alone(day: Path, driven: Driven) -> None:
    noon = driven_of(day, "noon").figures
    assert noon["tracking_rms_m"] <= 0.10
    assert noon["scans"] == 0
    assert driven.figures["tracking_rms_m"] <= 0.14
    assert driven.figures["engaged_way_m"] > 50.0
    wrong, fixes = wrong_fixes(day, "evening")
    assert wrong == 0
    assert fixes > 300
    with np.load(driven.folder / "truth.npz") as truth:
        assert np.hypot(np.ptp(truth["x_m"]), np.ptp(truth["y_m"])) > 40.0
    assert json.loads(succeed("events", driven.folder, "--json", "-"))["arrived"]


def test_in_lock_step_it_arrives_on_any_machine_and_tells_its_course(driven: Driven) -> None:
    found = driven.figures
    assert found["period_largest_ms"] == pytest.approx(20.0, abs=0.1)
    # Every figure stands in the table, in words and with its unit.
    assert set(found) <= {name for *_, names in _SHOWN for name in names} | {"modes"}
    assert re.search(r"│ [0-9.]+ cm, [0-9.]+ cm", driven.said)
    line = json.loads(succeed("events", driven.folder, "--json", "-"))
    assert (line["engaged"], line["arrived"], line["shortfall"], line["end"]) == (True, True, None, "ended")
    modes = [event["mode"] for event in line["events"] if event["kind"] == "mode"]
    assert modes == ["CHECKS", "READY", "STEERING", "SPEED", "MANUAL"]
    times = [event["time_s"] for event in line["events"]]
    assert times == sorted(times)


def test_a_simulated_run_becomes_a_drive_log(driven: Driven, tmp_path: Path) -> None:
    path = driven.folder / "evening.drive.h5"
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
