"""The runtime of a skid-steer vehicle as its user starts it: plan, devices in real time, figures, replay."""

import json
from pathlib import Path

import numpy as np
import pytest

from cli.test_run import ROOT, lgprjax
from lgprjax.cli.simulated_run import _SHOWN
from lgprjax.formats import read_cover_plan, read_run
from lgprjax.run_records import RecordKind, unpack
from lgprjax.runtime.smoothed import smooth_run
from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan
from lgprjax.worked.record import read_cover_run


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration of the field; a machine with other work keeps up."""
    folder = tmp_path_factory.mktemp("field")
    text = (ROOT / "onboard" / "field.run.toml").read_text(encoding="utf-8").replace("../out/onboard/", "")
    text = text.replace("made_up_flail.vehicle.toml", str(ROOT / "onboard/made_up_flail.vehicle.toml"))
    text = text.replace('"field.geojson"', f'"{ROOT / "onboard/field.geojson"}"')
    text += "\n[supervision]\ncontrol_s = 5.0\nothers_s = 20.0\nstart_s = 300.0\n\n[display]\nport = 0\n"
    (folder / "field.run.toml").write_text(text, encoding="utf-8")
    return folder / "field.run.toml"


def test_a_field_is_driven_recorded_and_replayed_to_the_same_frames(field: Path) -> None:
    figures = field.parent / "figures.json"
    # As if lines 1 and 2 were worked by another machine.
    begin = ("--start-line", "3", "--start-m", "4.5")
    arguments = ("--simulate", "--lockstep", *begin, "--for-s", "12", "--json", str(figures))
    done = lgprjax("run", str(field), *arguments, limit_s=600.0)
    # The plan takes longer than that.
    assert done.returncode == 1, done.stdout[-2000:] + done.stderr[-4000:]
    assert "did not arrive: " in done.stdout
    assert "runs taken up: 0; begins at line 3, metre 4.5" in done.stdout
    assert len(read_cover_plan(field.parent / "field.cover.geojson").pattern.lines) == 21
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["ticks"] > 300
    assert set(found) <= {name for *_, names in _SHOWN for name in names} | {"modes"}
    folder = next((field.parent / "runs").iterdir())
    kinds = {unpack(data).kind for _, data in read_run(folder)}
    assert {RecordKind.COVER, RecordKind.SKID_PLAN, RecordKind.PORT_IN, RecordKind.PORT_OUT} <= kinds
    run = read_cover_run(folder)
    smoothed, poses = smooth_run(run)
    # The forward pass over the recorded bytes is what the vehicle had; only the way back adds to it.
    near = np.searchsorted(poses.mono_ns, run.utc_ns - (run.utc_ns[-1] - poses.mono_ns[-1]) - 15_000_000)
    known = near < len(poses.mono_ns)
    live = np.stack([run.rows[name] for name in ("x_m", "y_m")], axis=1)[known]
    assert np.median(np.hypot(*(poses.live[near[known], :2] - live).T)) < 2e-3
    assert smoothed.provenance["poses"] == "smoothed forward and back"
    assert np.isfinite(smoothed.rows["x_m"]).all()
    out = folder / "replayed.json"
    again = lgprjax("run", str(folder / "simulated.run.toml"), "--replay", str(folder), "--json", str(out))
    assert again.returncode == 0, again.stdout + again.stderr
    told = json.loads(out.read_text(encoding="utf-8"))
    assert told["differing"] == 0
    assert told["frames"] >= told["ticks"] > 300


def test_what_cannot_be_taken_up_is_one_line(field: Path) -> None:
    plan = make_cover_plan(
        ROOT / "onboard/field.geojson", ROOT / "onboard/made_up_flail.vehicle.toml", PlanOptions(order="zamboni")
    )
    assert plan is not None
    save_cover_plan(field.parent / "field.cover.geojson", plan, force=True)
    done = lgprjax("run", str(field), "--simulate", "--start-line", "30")
    assert done.returncode == 1
    assert "start line: expected 1 to 21, found 30" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_simulated_configuration_does_not_wait_for_devices(field: Path) -> None:
    done = lgprjax("run", str(field))
    assert done.returncode == 1
    assert "simulation: expected --simulate as well, or no such table" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_configuration_that_is_of_both_kinds_is_one_line(field: Path) -> None:
    both = field.with_name("both.run.toml")
    both.write_text('map = "m.map.h5"\n' + field.read_text(encoding="utf-8"), encoding="utf-8")
    done = lgprjax("run", str(both))
    assert done.returncode == 1
    assert "expected either [coverage], or map and routes" in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
