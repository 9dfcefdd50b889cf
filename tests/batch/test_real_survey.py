"""A newcomer's path on real lines: four commands and no option, where positions lie beside the files.

Every recording: ``make validation NAME=surveys``.
"""

import re
from pathlib import Path

import pandas as pd
import pytest

from lgprjax.cli import main

pytestmark = pytest.mark.real


def run(*words: object) -> int:
    try:
        main([str(word) for word in words])
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


def test_four_commands_and_no_option(
    real_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lines of one day become a map; a line of the next day, its antennas turned about, is located beside its rim."""
    monkeypatch.chdir(tmp_path)
    lines = [real_data / "flagogna" / f"XLINE{number:03d}.DT1" for number in range(54, 68)]
    assert run("import", *lines[:-1], "-o", "day1.drive.h5") == 0
    printed = capsys.readouterr().out
    assert len(re.findall(r"^XLINE0\d\d\.DT1 ", printed, re.MULTILINE)) == 13
    assert "topography" in printed
    assert run("import", lines[-1], "-o", "day2.drive.h5") == 0
    assert run("view", "day1.drive.h5") == 0
    assert (tmp_path / "day1.drive.png").is_file()
    assert run("map", "build", "day1.drive.h5", "-o", "day1.map.h5") == 0
    assert run("register", "day1.map.h5", "day2.drive.h5", "-o", "located") == 0
    assert (tmp_path / "located" / "report.html").is_file()
    fixes = pd.read_csv(tmp_path / "located" / "day2.fixes.csv")
    # Its antennas are turned about: without the change of sign nothing would be found.
    assert (fixes["code"] == "ok").mean() > 0.6
