"""The runtime of a skid-steer vehicle as its user starts it: plan, devices in real time, figures, replay."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from canon.commands import run, succeed
from cli.processes import ROOT, lgprjax, quick
from lgprjax.cli.run import _SHOWN
from lgprjax.formats import read_cover_plan, read_run
from lgprjax.run_records import RecordKind, unpack
from lgprjax.runtime.smoothed import smooth_run
from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan
from lgprjax.worked.record import read_cover_run


@pytest.fixture(scope="module")
def field(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration of the field."""
    text = (ROOT / "onboard" / "field.run.toml").read_text(encoding="utf-8")
    return quick(text, tmp_path_factory.mktemp("field") / "field.run.toml")


def test_a_field_is_driven_recorded_and_replayed_to_the_same_frames(field: Path) -> None:
    figures = field.parent / "figures.json"
    # As if lines 1 and 2 were worked by another machine, which works the last one too.
    begin = ("--start-line", "3", "--start-m", "4.5", "--end-line", "20")
    arguments = ("--simulate", "--lockstep", *begin, "--for-s", "7", "--json", str(figures))
    done = lgprjax("run", str(field), *arguments)
    # The plan takes longer than that.
    assert done.status == 1, done.out[-2000:] + done.err[-4000:]
    assert "did not arrive: " in done.out
    assert "line 3, metre 4.5" in done.out
    lines = read_cover_plan(field.parent / "field.cover.geojson").pattern.lines
    assert len(lines) == 21
    left_m = re.findall(r"^(\d+) m ", done.out, re.MULTILINE)
    assert left_m == [f"{np.hypot(*(lines[-1].end_m - lines[-1].start_m)):.0f}"]
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["ticks"] > 300
    assert set(found) <= {name for *_, names in _SHOWN for name in names} | {"modes"}
    folder = next((field.parent / "runs").iterdir())
    kinds = {unpack(data).kind for _, data in read_run(folder)}
    assert {RecordKind.COVER, RecordKind.SKID_PLAN, RecordKind.PORT_IN, RecordKind.PORT_OUT} <= kinds
    drive = read_cover_run(folder)
    smoothed, poses = smooth_run(drive)
    # The forward pass over the recorded bytes is what the vehicle had; only the way back adds to it.
    near = np.searchsorted(poses.mono_ns, drive.utc_ns - (drive.utc_ns[-1] - poses.mono_ns[-1]) - 15_000_000)
    known = near < len(poses.mono_ns)
    live = np.stack([drive.rows[name] for name in ("x_m", "y_m")], axis=1)[known]
    assert np.median(np.hypot(*(poses.live[near[known], :2] - live).T)) < 2e-3
    assert smoothed.provenance["poses"] == "smoothed forward and backward"
    assert np.isfinite(smoothed.rows["x_m"]).all()
    told = json.loads(succeed("run", folder / "simulated.run.toml", "--replay", folder, "--json", "-"))
    assert told["differing"] == 0
    assert told["frames"] >= told["ticks"] > 300


def test_what_cannot_be_taken_up_or_started_is_one_line(field: Path, tmp_path: Path) -> None:
    plan = make_cover_plan(
        ROOT / "onboard/field.geojson", ROOT / "onboard/made_up_flail.vehicle.toml", PlanOptions(order="zamboni")
    )
    assert plan is not None
    save_cover_plan(field.parent / "field.cover.geojson", plan, force=True)
    both = tmp_path / "both.run.toml"
    both.write_text('map = "m.map.h5"\n' + field.read_text(encoding="utf-8"), encoding="utf-8")
    for words, file, place, values in (
        ((field, "--simulate", "--start-line", "30"), "field.cover.geojson", "start line", ("1 to 21", 30)),
        (
            (field, "--simulate", "--start-line", "3", "--end-line", "2"),
            "field.cover.geojson",
            "end line",
            ("3 to 21", 2),
        ),
        # A simulated configuration does not wait for devices.
        ((field,), field, "simulation", ("--simulate",)),
        ((both,), both, "map, routes, coverage", ("[coverage]",)),
    ):
        done = run("run", *words)
        assert done.status == 1
        done.refusal.check(place, *values, file=file)
