"""The notebooks: short, with their outputs kept, each beside the same as a script; each runs from a fresh clone."""

import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jupytext
import nbformat
import numpy as np
import pandas as pd
import pytest
from nbclient import NotebookClient

import lgprjax
from lgprjax.formats import check_file, read_cover_plan, read_vehicle, read_worked
from lgprjax.simulation import read_vehicle_plan

_ROOT = Path(__file__).parents[1]
_NOTEBOOKS = sorted(path.stem for path in (_ROOT / "notebooks").glob("*.ipynb"))
_COVERAGE = "coverage_record"
_LOCATED = ("archive", "drive_health", "first_registration", "own_radar")
_LOGGED = ("first_tracking", "weak_servo", "what_logs_tell")

_TRUE: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "palm_tree": ("steering.potentiometer_v_per_rad", lambda plan: plan.vehicle.potentiometer_per_rad_v[0]),
    "encoder_potentiometer": ("steering.encoder_counts_per_rad", lambda plan: plan.vehicle.encoder_counts_per_rad),
    "k_ratio": ("steering.rear_ratio", lambda plan: plan.vehicle.rear),
    "fusion": ("navigation.yaw_rate_noise", lambda plan: plan.drives[-1].sensors.yaw_rate_noise),
}


def _read(name: str) -> Any:
    return nbformat.read(_ROOT / "notebooks" / f"{name}.ipynb", as_version=4)  # type: ignore[no-untyped-call]


def test_there_is_a_notebook_for_each_session() -> None:
    sessions = [_COVERAGE, "encoder_potentiometer", "fusion", "k_ratio", "look_ahead", "palm_tree"]
    assert sorted([*_LOCATED, *_LOGGED, *sessions]) == _NOTEBOOKS


@pytest.mark.parametrize("name", _NOTEBOOKS)
def test_the_script_beside_a_notebook_is_the_same(name: str) -> None:
    script = jupytext.read(_ROOT / "notebooks" / f"{name}.py")
    assert [(cell.cell_type, cell.source) for cell in script.cells] == [
        (cell.cell_type, cell.source) for cell in _read(name).cells
    ]


@pytest.mark.parametrize("name", _NOTEBOOKS)
def test_notebook_is_short_and_keeps_its_pictures(name: str) -> None:
    book = _read(name)
    assert len(book.cells) <= 12
    outputs = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert [cell.execution_count for cell in book.cells if cell.cell_type == "code"] == list(
        range(1, 1 + sum(cell.cell_type == "code" for cell in book.cells))
    )
    # No one's folders, and public names only.
    source = "\n".join(cell.source for cell in book.cells)
    assert not re.search(r"[\"'(\s]/(home|tmp|work|root|Users)", source + str(outputs))
    assert not re.search(r"(import|\.) _", source)


def _run(name: str, clone: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, str]:
    """Run a notebook in a copy of what a clone has; the folder that it writes to, and what it printed."""
    # The kernel finds the package that these tests found, however it is installed.
    monkeypatch.setenv("PYTHONPATH", str(Path(lgprjax.__file__).parents[1]))
    if os.environ.get("LGPRJAX_TEST_CACHE"):
        monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", os.environ["LGPRJAX_TEST_CACHE"])
    for folder in ("notebooks", "tuning", "onboard"):
        shutil.copytree(_ROOT / folder, clone / folder)
    book = _read(name)
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(clone / "notebooks")}}).execute()
    printed = [output.get("text", "") for cell in book.cells for output in cell.get("outputs", [])]
    return clone / "out" / "notebooks" / name, "".join(printed)


def test_the_field_of_the_notebook_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = _run(_COVERAGE, tmp_path, monkeypatch)
    record, plan = read_worked(folder / "field.worked.h5"), read_cover_plan(folder / "field.cover.geojson")
    assert abs(plan.pattern.field.area_m2 - 12.0 * 9.0) < 0.1
    assert len(record.stops.run) == 1
    processed = np.count_nonzero(record.cells.state[0] == 2) * record.cells.cell_m**2
    # The tool also worked a strip as long as itself beyond both ends of every line.
    assert 100.0 < processed < 108.0 + 10 * 2 * 1.2 * 0.6
    assert {path.suffix for path in (folder / "export").iterdir()} == {
        *(".csv", ".geojson", ".gpkg", ".html", ".kml", ".zip")
    }


def test_the_first_registration_is_right_and_refuses_the_impostor(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, printed = _run("first_registration", tmp_path, monkeypatch)
    assert "'impostor': 0}" in printed
    (fixes_cm,) = re.findall(r"fixes ([\d.]+) cm", printed)
    assert float(fixes_cm) < 5.0


def test_an_archive_gains_by_baselines_that_agree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = _run("archive", tmp_path, monkeypatch)
    before, after = (pd.read_csv(folder / name / "archive.csv", index_col="drive") for name in ("before", "after"))
    assert before["ok"]["elsewhere"] == after["ok"]["elsewhere"] == 0
    for drive in ("clear", "snow", "years"):
        assert after["ok"][drive] >= before["ok"][drive] > 0
        assert after["correlation_ok"][drive] > before["correlation_ok"][drive] + 0.05
        assert after["ok"][drive] > 0.7 * after["tried"][drive]


def test_lines_of_ones_own_radar_are_located(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, printed = _run("own_radar", tmp_path, monkeypatch)
    assert check_file(folder / "site.map.h5") == []
    ((along, across),) = re.findall(r"off by (-?[\d.]+) m along the lines, (-?[\d.]+) m across", printed)
    assert abs(float(along) - 0.4) < 0.06
    assert abs(float(across) + 0.1) < 0.06


def test_the_faults_of_the_drive_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = _run("drive_health", tmp_path, monkeypatch)
    assert "sound: 1819 scans, 65 m: good" in printed
    for name in ("dropped_scans", "dead_channels", "odometer_scale"):
        assert f"faulty: bad: {name}" in printed
    assert "sound: bad" not in printed


@pytest.mark.parametrize("name", [name for name in _NOTEBOOKS if name not in (_COVERAGE, *_LOCATED, *_LOGGED)])
def test_notebook_runs_from_a_fresh_clone(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (result,) = _run(name, tmp_path, monkeypatch)[0].glob("*.vehicle.toml")
    assert check_file(result) == []
    vehicle = read_vehicle(result)
    if name == "look_ahead":
        assert vehicle.pursuit.short_m is not None
        assert vehicle.pursuit.long_m is not None
        assert 0.0 < vehicle.pursuit.short_m < vehicle.pursuit.long_m
        return
    path, truth_of = _TRUE[name]
    truth = truth_of(read_vehicle_plan(_ROOT / "tuning" / "drives.toml"))
    found = vehicle.found[path]
    assert isinstance(found.low, float)
    assert isinstance(found.high, float)
    assert found.study == name
    assert found.low < truth < found.high


def test_logged_runs_become_a_vehicle_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, _ = _run("first_tracking", tmp_path, monkeypatch)
    vehicle = read_vehicle(folder / "tracking.vehicle.toml")
    truth = read_vehicle_plan(_ROOT / "tuning" / "tracking_drives.toml").vehicle
    assert vehicle.steering.lag_s == pytest.approx(truth.lag_s, rel=0.1)
    assert vehicle.steering.largest_wheel_rate_radps == pytest.approx(truth.rate_radps, rel=0.05)
    assert vehicle.steering.rear_ratio == pytest.approx(truth.rear, abs=0.04)
    assert vehicle.pursuit.weak_exponent is not None
    assert vehicle.pursuit.weak_exponent > 0.1


def test_logs_that_do_not_tell_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = _run("what_logs_tell", tmp_path, monkeypatch)
    assert "largest rate of the servo: left open" in printed
    assert "vehicle file: full" in printed
    assert printed.count("expected") == 4


def test_a_weak_servo_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _, printed = _run("weak_servo", tmp_path, monkeypatch)
    assert "gentle - torque of the servo against the vehicle file: not observable" in printed
    assert "first, second - torque of the servo against the vehicle file: weak" in printed
