"""``lgprjax export`` and ``lgprjax import mcap`` as a person meets them."""

import sys
from pathlib import Path

import pytest

from canon.commands import run, succeed
from canon.story import Story
from formats.mcap_sample import rover_messages, write_curved, write_recording


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    write_curved(tmp_path / "a.drive.h5", scans=120)
    return tmp_path / "a.drive.h5"


def test_there_and_back(drive: Path, story: Story) -> None:
    exported, imported = story.step("export").done.out, story.step("import mcap").done.out
    # What there are no messages for is told, and where the drive was.
    assert exported.splitlines()[-1].startswith("result: wrote live.mcap: ")
    assert "truth" in exported
    assert imported.splitlines()[0].startswith("place: 42.")
    assert imported.splitlines()[-2].startswith("result: wrote again.drive.h5: ")
    recording, again = drive.with_name("a.mcap"), drive.with_name("b.drive.h5")
    for forced in ((), ("--force",)):
        succeed("export", drive, "-o", recording, *forced)
        succeed("import", "mcap", recording, "-o", again, *forced)


def test_options_reach_the_drive_and_notes_the_user(tmp_path: Path) -> None:
    messages = [each for each in rover_messages() if each[0] != "/rover/imu"]
    path = write_recording(tmp_path / "rover.mcap", messages)
    command = ("import", "mcap", path, "-o", tmp_path / "x.drive.h5")
    done = run(*command)
    assert done.status == 1
    assert "--channel-pitch-m" in done.refusal.expected
    assert "2" in done.refusal.found
    options = ("--channel-pitch-m", 0.2, "--array-height-m", 0.3, "--gnss-m", 1, 0, 1.5)
    assert "heading" in succeed(*command, *options)
    topics = ("--radar-topic", "/rover/gpr", "--gnss-topic", "/rover/gps", "--odometry-topic", "/rover/odom")
    asked = (*topics, "--heading-topic", "/rover/odom", "--heading-sigma-deg", 2)
    assert "heading from" not in succeed(*command, *options, *asked, "--force")
    done = run(*command, *options, "--gnss-sigma-m", -1)
    assert done.status == 2
    done.refusal.check("--gnss-sigma-m", found=-1)


def test_bad_input_is_one_line(drive: Path) -> None:
    wrong, none, log = drive.with_name("x.mcap"), drive.with_name("no.fixes.h5"), drive.with_name("y.drive.h5")
    wrong.write_bytes(b"GIF89a")
    before = sorted(drive.parent.iterdir())
    for file, value, command in (
        (wrong, "MCAP", ("import", "mcap", wrong, "-o", log)),
        (wrong, "HDF5", ("export", wrong, "-o", drive.with_name("y.mcap"))),
        (none, "", ("export", drive, "--fixes", none, "-o", drive.with_name("y.mcap"))),
    ):
        done = run(*command)
        assert done.status == 1
        done.refusal.check("file", value, file=file)
    done = run("export", drive, "-o", drive.with_name("y.csv"))
    assert done.status == 2
    assert all(suffix in done.err for suffix in (".mcap", ".bag", ".db3", ".tum", "y.csv"))
    assert sorted(drive.parent.iterdir()) == before


@pytest.mark.parametrize("verb", ["export", "import"])
def test_the_package_that_is_missing_is_named(verb: str, drive: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recording = write_recording(drive.with_name("r.mcap"), rover_messages(5))
    for name in [name for name in sys.modules if name == "mcap" or name.startswith("mcap.")]:
        monkeypatch.setitem(sys.modules, name, None)
    command: tuple[object, ...] = ("export", drive, "-o", drive.with_name("x.mcap"))
    if verb == "import":
        command = ("import", "mcap", recording, "-o", drive.with_name("x.drive.h5"))
    done = run(*command)
    assert done.status == 1
    assert "lgprjax[log]" in done.refusal.expected
