"""The unit that a vehicle runs, held by systemd's own checker."""

import configparser
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from lgprjax.runtime.config import SupervisionTable

UNIT = Path(__file__).parents[2] / "systemd" / "lgprjax.service"


def verify(folder: Path, text: str) -> tuple[int, str]:
    """Exit status of ``systemd-analyze verify`` and what it says of a unit."""
    if shutil.which("systemd-analyze") is None:
        if os.environ.get("CI"):
            pytest.fail("systemd-analyze is not installed")
        pytest.skip("systemd-analyze is not installed: the unit is not verified here")
    unit = folder / "lgprjax.service"
    unit.write_text(text)
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False, timeout=60
    )
    # What it says of other units of this machine is not ours.
    lines = [line for line in (done.stdout + done.stderr).splitlines() if "lgprjax" in line]
    return done.returncode, "\n".join(lines)


def unit_text() -> str:
    """The unit with a program that a test machine has."""
    text = UNIT.read_text()
    (start,) = [line for line in text.splitlines() if line.startswith("ExecStart=")]
    assert "lgprjax run " in start
    return text.replace(start, "ExecStart=/bin/true")


def test_the_unit_is_accepted_without_a_word(tmp_path: Path) -> None:
    assert verify(tmp_path, unit_text()) == (0, "")
    # The check sees a mistake.
    assert "often" in verify(tmp_path, unit_text().replace("WatchdogSec=1", "WatchdogSec=often"))[1]


def test_its_times_fit_the_supervisor() -> None:
    parser = configparser.ConfigParser(strict=False, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(UNIT)
    service = parser["Service"]
    assert service["Type"] == "notify"
    # The control process feeds the watchdog, not the one that systemd started.
    assert service["NotifyAccess"] == "all"
    assert float(service["WatchdogSec"]) > SupervisionTable().control_s
    assert float(service["TimeoutStartSec"]) > SupervisionTable().start_s
    assert float(service["TimeoutStopSec"]) > 3 * 5.0
    assert "MemoryDenyWriteExecute" not in service
    assert service.get("PrivateDevices", "no") == "no"
