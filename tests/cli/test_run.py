"""The runtime as its user starts it: simulated devices in real time, the drive log, the replay, the preflight."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.cli import main
from lgprjax.cli.simulated_run import _SHOWN
from lgprjax.formats import VehicleLog, read_run
from lgprjax.process_cost import count_compiles
from lgprjax.run_records import RecordKind, unpack

ROOT = Path(__file__).resolve().parents[2]
CODE = "import sys; from lgprjax.cli import main; main(sys.argv[1:])"


def lgprjax(*arguments: str, limit_s: float = 400.0, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", CODE, *arguments],
        capture_output=True,
        text=True,
        timeout=limit_s,
        check=False,
        env={**os.environ, **environment},
    )


@pytest.fixture(scope="module")
def course(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration of a short course with a third of the scans: a machine with other work keeps up."""
    folder = tmp_path_factory.mktemp("run")
    text = (ROOT / "onboard" / "simulated.run.toml").read_text(encoding="utf-8")
    text = text.replace("../out/onboard/", "").replace(
        "made_up.vehicle.toml", str(ROOT / "onboard/made_up.vehicle.toml")
    )
    text = text.replace("length_m = 300.0", "length_m = 80.0\nscan_share = 3")
    # Where other tests run beside it the loop may be late; what is shown here is that everything fits together.
    text += "\n[supervision]\ncontrol_s = 5.0\nothers_s = 20.0\nstart_s = 300.0\n\n[display]\nport = 0\n"
    (folder / "short.run.toml").write_text(text, encoding="utf-8")
    return folder / "short.run.toml"


@pytest.fixture(scope="module")
def driven(course: Path) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """A run of some seconds: its folder, and what was printed."""
    figures = course.parent / "figures.json"
    arguments = ("--simulate", "--realtime", "--for-s", "12", "--json", str(figures))
    done = lgprjax("run", str(course), *arguments, limit_s=600.0)
    # Twelve seconds do not lead to the end of 80 m.
    assert done.returncode == 1, done.stdout[-2000:] + done.stderr[-4000:]
    assert len(re.findall(r"^did not arrive: .+; lgprjax events .+ tells more$", done.stdout, re.MULTILINE)) == 1
    folder = next((course.parent / "runs").iterdir())
    return folder, done


def test_a_simulated_run_becomes_a_drive_log(driven: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, done = driven
    assert re.search(r"ready after [0-9.]+ s", done.stdout)
    log = VehicleLog.open(folder / "simulated.drive.h5")
    assert log.vehicle is not None
    assert {"steering_potentiometer_v", "encoder_counts", "throttle", "brake", "mode"} <= set(log.vehicle)
    checked = lgprjax("check", str(folder / "simulated.drive.h5"))
    assert checked.returncode == 0, checked.stdout + checked.stderr
    figures = json.loads((folder.parents[1] / "figures.json").read_text(encoding="utf-8"))
    assert figures["ticks"] > 300
    assert figures["scans"] > 200
    assert (folder / "timing.png").read_bytes().startswith(b"\x89PNG")


def test_nothing_is_compiled_once_a_process_is_ready(
    driven: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    events = [unpack(data) for _, data in read_run(driven[0])]
    told = [event.payload.decode() for event in events if event.kind is RecordKind.EVENT]
    assert any('"ready": "registration"' in text for text in told)
    assert not [text for text in told if "compiled" in text]


def test_a_compilation_is_counted() -> None:
    compiles = count_compiles()
    jax.jit(lambda x: x * 3.25 + 1.0)(jnp.arange(3, dtype=jnp.float32))
    assert compiles() >= 1
    before = compiles()
    np.testing.assert_allclose(np.arange(3), np.arange(3))
    assert compiles() == before


def test_the_run_replays_to_the_same_commands(driven: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = driven
    out = folder / "replayed.json"
    done = lgprjax("run", str(folder / "simulated.run.toml"), "--replay", str(folder), "--json", str(out))
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(out.read_text(encoding="utf-8"))
    assert found["differing"] == 0
    assert found["broken"] is None
    assert found["ticks"] > 300
    assert found["frames"] >= found["ticks"]


def test_a_run_is_recovered_from_its_folder(driven: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = driven
    done = lgprjax("recover", str(folder), "-o", str(folder / "again.drive.h5"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "ended" in done.stdout


def test_in_lock_step_it_arrives_on_any_machine_and_tells_its_course(
    course: Path, driven: tuple[Path, subprocess.CompletedProcess[str]]
) -> None:
    before = set((course.parent / "runs").iterdir())
    assert driven[0] in before
    figures = course.parent / "lockstep.json"
    arguments = ("--simulate", "--lockstep", "--for-s", "90", "--json", str(figures))
    done = lgprjax("run", str(course), *arguments, limit_s=600.0)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    assert "arrived: engaged, and at the end of the way" in done.stdout
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["tracking_rms_m"] < 0.15
    assert found["period_largest_ms"] == pytest.approx(20.0, abs=0.1)
    # Every figure stands in the table, in words and with its unit.
    assert set(found) <= {name for *_, names in _SHOWN for name in names} | {"modes"}
    assert re.search(r"off the baseline, RMS, largest +│ [0-9.]+ cm, [0-9.]+ cm", done.stdout)
    folder = next(iter(set((course.parent / "runs").iterdir()) - before))
    told = lgprjax("events", str(folder), "--json", str(folder / "events.json"))
    assert told.returncode == 0, told.stdout + told.stderr
    line = json.loads((folder / "events.json").read_text(encoding="utf-8"))
    assert (line["engaged"], line["arrived"], line["shortfall"], line["end"]) == (True, True, None, "ended")
    modes = [event["mode"] for event in line["events"] if event["kind"] == "mode"]
    assert modes == ["CHECKS", "READY", "STEERING", "SPEED", "MANUAL"]
    times = [event["time_s"] for event in line["events"]]
    assert times == sorted(times)


@pytest.mark.campaign
def test_a_radar_of_sweeps_drives_on_the_ground_alone_and_its_log_gives_the_same_fixes(course: Path) -> None:
    """Sweeps whose gain drifts by a tenth while it drives; GNSS is lost before anything is engaged, and stays so."""
    folder = course.parent / "swept"
    folder.mkdir()
    text = course.read_text(encoding="utf-8").replace("at_way_m = 12.0", "at_way_m = 24.0")
    swept = 'recording = "sweeps"\ngain_drift = 1.2\nfaults = [{ kind = "gnss_off", at_way_m = 16.0 }]'
    text = text.replace("scan_share = 3", f"scan_share = 3\n{swept}")
    (folder / "swept.run.toml").write_text(text, encoding="utf-8")
    figures = folder / "figures.json"
    arguments = ("--simulate", "--lockstep", "--for-s", "90", "--json", str(figures))
    done = lgprjax("run", str(folder / "swept.run.toml"), *arguments, limit_s=900.0)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-4000:]
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["ok_share"] > 0.97
    assert found["tracking_rms_m"] < 0.15
    run = next((folder / "runs").iterdir())
    out = folder / "again"
    told = lgprjax(
        "register", str(folder / "course300.map.h5"), str(run / "simulated.drive.h5"), "-o", str(out), "--track"
    )
    assert told.returncode == 0, told.stdout + told.stderr
    agreed = re.search(r"as on board: (\d+) of (\d+) fixes with the same code, at most (\S+) mm apart", told.stdout)
    assert agreed is not None, told.stdout
    assert agreed[1] == agreed[2]
    assert int(agreed[2]) > 100
    assert float(agreed[3]) < 1.0


def test_a_preflight_names_what_is_not_in_order(course: Path) -> None:
    done = lgprjax("run", str(course), "--preflight")
    assert done.returncode == 1
    assert "NOT OK" in done.stdout
    assert "drive_by_wire" in done.stdout


def test_a_configuration_that_is_not_there_is_one_line() -> None:
    done = lgprjax("run", "nowhere.run.toml")
    assert done.returncode == 1
    expected = "expected a readable file, found No such file or directory; check its name and folder"
    assert done.stderr.strip() == f"lgprjax: nowhere.run.toml: file: {expected}"


def test_packages_that_are_missing_are_one_line_before_anything_starts(
    course: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(course.parent.iterdir())
    monkeypatch.setitem(sys.modules, "pyubx2", None)
    with pytest.raises(SystemExit) as stopped:
        main(["run", str(course), "--simulate"])
    assert stopped.value.code == 1
    assert 'pip install "lgprjax[onboard]"), found no pyubx2' in capsys.readouterr().err
    assert sorted(course.parent.iterdir()) == before
