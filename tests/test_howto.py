"""The how-to pages: their commands and their Python, run in order, each page in a folder of its own."""

import re
import shlex
from pathlib import Path

import numpy as np
import pyogrio
import pytest
from rosbags.highlevel import AnyReader

from formats.mcap_sample import curved_fixes, write_curved
from formats.test_signal_tables import columns, write_csv
from lgprjax.cli import main
from lgprjax.formats import DriveLog, export_mcap

_DOCS = Path(__file__).parents[1] / "docs"
_BLOCK = re.compile(r"^<!-- run -->\n```(sh|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def _follow(page: str) -> int:
    """Run the blocks of a page in the present folder; how many commands there were."""
    commands = 0
    for language, text in _BLOCK.findall((_DOCS / page).read_text(encoding="utf-8")):
        if language == "python":
            exec(text, {})
            continue
        for line in text.splitlines():
            with pytest.raises(SystemExit) as stopped:
                main(shlex.split(line)[1:])
            assert stopped.value.code == 0, line
            commands += 1
    return commands


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_bring_your_own_radar() -> None:
    assert _follow("own_radar.md") == 3
    with DriveLog.open("first.drive.h5") as log:
        assert (log.scans, log.channels, log.samples) == (500, 11, 256)
    assert Path("first.png").stat().st_size > 10_000


def test_bring_your_own_vehicle() -> None:
    write_csv(Path("LOG.csv"), columns())
    assert _follow("own_vehicle.md") == 6
    assert Path("log.drive.h5").is_file()


def test_from_ros2() -> None:
    write_curved(Path("x.drive.h5"), "int16", scans=120)
    export_mcap("x.drive.h5", "RECORDING.mcap")
    Path("result").mkdir()
    curved_fixes(Path("result"), "drive", scans=120)
    assert _follow("from_ros2.md") == 9
    assert Path("out.mcap").stat().st_size > 10_000
    with AnyReader([Path("out.bag")]) as one, AnyReader([Path("out.db3")]) as two:
        assert one.message_count == two.message_count > 300
    # Times, places and quaternions, as evo reads them; a pose a scan, and a pose a fix.
    assert np.loadtxt("gnss.tum").shape == (120, 8)
    assert np.loadtxt("fixes.tum").shape == (40, 8)
    # By the library that QGIS reads with.
    fixes = pyogrio.raw.read("fixes.geojson")
    assert {"code", "correlation", "sigma_cross_m"} <= set(fixes[0]["fields"])
    assert len(fixes[2]) == 41
