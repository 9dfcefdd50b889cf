"""A run in real time against simulated devices: it drives, draws its periods, and compiles nothing once it is ready."""

import json
import re
from pathlib import Path

from canon.commands import succeed
from canon.record import record
from cli.processes import ROOT, lgprjax, quick
from lgprjax.formats import read_run
from lgprjax.run_records import RecordKind, unpack


def write_course(folder: Path) -> Path:
    """A configuration of a short course with a third of the scans; its map and route come from a drive by hand."""
    recorded = record(folder / "first", 30.0, ("scan_share = 6", "scan_share = 3"))
    succeed("map", "build", recorded.folder, "-o", folder / "first.map.h5")
    words = ("route", "select", folder / "first.map.h5", "record")
    vehicle = ROOT / "onboard" / "made_up.vehicle.toml"
    succeed(*words, "--vehicle", vehicle, "-o", folder / "first.route.toml")
    text = (ROOT / "onboard" / "simulated.run.toml").read_text(encoding="utf-8")
    text = text.replace("length_m = 300.0", "length_m = 60.0\nscan_share = 3")
    return quick(text.replace("course300", "first"), folder / "short.run.toml")


def test_in_real_time_nothing_is_compiled_once_a_process_is_ready(tmp_path: Path) -> None:
    course = write_course(tmp_path)
    figures = course.parent / "figures.json"
    arguments = ("--simulate", "--realtime", "--for-s", "6", "--json", str(figures))
    done = lgprjax("run", str(course), *arguments)
    # Six seconds do not lead to the end of 60 m.
    assert done.status == 1, done.out[-2000:] + done.err[-4000:]
    assert len(re.findall(r"^result: did not arrive: .+\nnext: lgprjax events ", done.out, re.MULTILINE)) == 1
    found = json.loads(figures.read_text(encoding="utf-8"))
    assert found["ticks"] > 150
    assert found["scans"] > 50
    (folder,) = (course.parent / "runs").iterdir()
    assert (folder / "timing.png").read_bytes().startswith(b"\x89PNG")
    events = [unpack(data) for _, data in read_run(folder)]
    told = [event.payload.decode() for event in events if event.kind is RecordKind.EVENT]
    assert any('"ready": "registration"' in text for text in told)
    assert not [text for text in told if "compiled" in text]
