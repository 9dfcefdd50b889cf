"""``lgprjax simulate`` as a person meets it."""

from pathlib import Path

import pytest

from lgprjax.cli import main
from lgprjax.formats import DriveLog, check_file

SITE = """
name = "tiny"
[ground]
length_m = 6
[array]
channels = 3
[[drive]]
name = "one"
stop_m = 2
[[drive]]
name = "two"
day = "frost"
stop_m = 3
"""


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main(["simulate", *(str(a) for a in arguments)])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


@pytest.fixture
def site(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(SITE)
    return path


def test_drives_are_written_and_told(site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "deep" / "out"
    assert run(site, "-o", out) == 0
    told = capsys.readouterr().out
    assert all(word in told for word in ("one", "two", "frost", "clear"))
    assert sorted(path.name for path in out.iterdir()) == ["one.drive.h5", "two.drive.h5"]
    assert [finding for path in out.iterdir() for finding in check_file(path)] == []
    with DriveLog.open(out / "two.drive.h5") as log:
        assert f" {log.scans} " in told
    # The same again is refused and leaves the files as they are; one that is asked for alone is the same drive.
    before = {path.name: path.stat().st_mtime_ns for path in out.iterdir()}
    assert run(site, "-o", out) == 1
    assert "one.drive.h5: output: expected a new file, or --force, found one that exists" in capsys.readouterr().err
    with DriveLog.open(out / "two.drive.h5") as log:
        first, _ = log.read_traces(0, log.scans)
    assert run(site, "-o", out, "--only", "two", "--force") == 0
    assert before["one.drive.h5"] == (out / "one.drive.h5").stat().st_mtime_ns
    assert before["two.drive.h5"] != (out / "two.drive.h5").stat().st_mtime_ns
    with DriveLog.open(out / "two.drive.h5") as log:
        again, _ = log.read_traces(0, log.scans)
    assert (first == again).all()


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (SITE + "lane = 1", (), "drive[2].lane: expected a key, perhaps lane_m, found an unknown key"),
        (SITE, ("--only", "three"), "--only: expected drives among one, two, found three"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, options: tuple[str, ...], message: str
) -> None:
    site.write_text(text)
    assert run(site, "-o", tmp_path / "out", *options) == 1
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert message in error
    assert not (tmp_path / "out").exists()
