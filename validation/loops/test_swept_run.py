"""A simulated run of a radar of sweeps, from the command line to the fixes of its log."""

import json
import re
from pathlib import Path

from cli.processes import ROOT, lgprjax, quick


def test_a_radar_of_sweeps_drives_on_the_ground_alone_and_its_log_gives_the_same_fixes(tmp_path: Path) -> None:
    """Sweeps whose gain drifts by a tenth while it drives; GNSS is lost before anything is engaged, and stays so."""
    text = (ROOT / "onboard" / "simulated.run.toml").read_text(encoding="utf-8")
    swept = 'recording = "sweeps"\ngain_drift = 1.2\nfaults = [{ kind = "gnss_off", at_way_m = 16.0 }]'
    text = text.replace("length_m = 300.0", f"length_m = 80.0\nscan_share = 3\n{swept}")
    course = quick(text.replace("at_way_m = 12.0", "at_way_m = 24.0"), tmp_path / "swept.run.toml")
    figures = tmp_path / "figures.json"
    arguments = ("--simulate", "--lockstep", "--for-s", "90", "--json", str(figures))
    done = lgprjax("run", str(course), *arguments, limit_s=900.0)
    assert done.status == 0, done.out[-2000:] + done.err[-4000:]
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["ok_share"] > 0.97
    assert found["tracking_rms_m"] < 0.15
    log = next((tmp_path / "runs").iterdir()) / "simulated.drive.h5"
    told = lgprjax("register", str(tmp_path / "course300.map.h5"), str(log), "-o", str(tmp_path / "again"), "--track")
    assert told.status == 0, told.out + told.err
    agreed = re.search(r": (\d+) of (\d+) fixes .* (\S+) mm", told.out)
    assert agreed is not None, told.out
    assert agreed[1] == agreed[2]
    assert int(agreed[2]) > 100
    assert float(agreed[3]) < 1.0
