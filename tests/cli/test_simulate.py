"""``lgprjax simulate`` as a person meets it."""

from pathlib import Path

import pytest

from canon.commands import run, succeed
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


@pytest.fixture
def site(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(SITE)
    return path


def test_drives_are_written_and_told(site: Path, tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    told = succeed("simulate", site, "-o", out)
    assert all(word in told for word in ("one", "two", "frost", "clear"))
    one, two = (out / f"{name}.drive.h5" for name in ("one", "two"))
    assert sorted(out.iterdir()) == [one, two]
    assert [finding for path in (one, two) for finding in check_file(path)] == []
    with DriveLog.open(two) as log:
        assert f" {log.scans} " in told
        first, _ = log.read_traces(0, log.scans)
    # The same again is refused and leaves the files as they are; one that is asked for alone is the same drive.
    before = one.stat().st_mtime_ns, two.stat().st_mtime_ns
    run("simulate", site, "-o", out).refusal.check("output", "--force", file=one)
    succeed("simulate", site, "-o", out, "--only", "two", "--force")
    assert before[0] == one.stat().st_mtime_ns
    assert before[1] != two.stat().st_mtime_ns
    with DriveLog.open(two) as log:
        again, _ = log.read_traces(0, log.scans)
    assert (first == again).all()


def test_what_is_wrong_is_one_line_and_nothing_is_written(site: Path, tmp_path: Path) -> None:
    out = ("-o", tmp_path / "out")
    done = run("simulate", site, *out, "--only", "three")
    assert (done.status, done.refusal.place) == (1, "--only")
    done.refusal.check(None, "one, two", found="three")
    site.write_text(SITE + "lane = 1")
    done = run("simulate", site, *out)
    assert done.status == 1
    done.refusal.check("drive[2].lane", "lane_m", file=site)
    assert not (tmp_path / "out").exists()
