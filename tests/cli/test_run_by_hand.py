"""Runs of a field without a plan, as their users start them: by remote control, and of a hand cart."""

import json
from pathlib import Path

import numpy as np
import pytest

from canon.commands import succeed
from cli.processes import ROOT, lgprjax, quick
from lgprjax.formats import read_worked
from lgprjax.run_records import ToolBits


def driven(name: str, folder: Path, for_s: int) -> Path:
    """The run of an example in lock step."""
    text = (ROOT / "onboard" / f"{name}.run.toml").read_text(encoding="utf-8")
    file = quick(text, folder / f"{name}.run.toml")
    done = lgprjax("run", str(file), "--simulate", "--lockstep", "--for-s", str(for_s))
    assert done.status == 0, done.out[-2000:] + done.err[-4000:]
    return next((folder / "runs").iterdir())


def test_a_field_by_remote_control(tmp_path: Path) -> None:
    folder = driven("hand_driven", tmp_path, 38)
    told = json.loads(succeed("run", folder / "simulated.run.toml", "--replay", folder, "--json", "-"))
    assert told["differing"] == 0
    succeed("cover", "record", folder, "-o", tmp_path / "r.worked.h5")
    record = read_worked(tmp_path / "r.worked.h5")
    assert sum(record.passes.length_m) > 3.0
    with np.load(folder / "truth.npz") as truth:
        worked_s = float(np.sum((truth["turns"] > 0.5) & (truth["depth_m"] > 0.12))) / 100.0
    counts = (record.channels.tool & ToolBits.COUNTS) != 0
    assert counts.sum() / 10.0 == pytest.approx(worked_s, rel=0.05)
