"""``lgprjax export`` and ``lgprjax import mcap`` as a person meets them."""

import subprocess
import sys
from pathlib import Path

import pytest

from formats.mcap_sample import rover_messages, write_curved, write_recording
from lgprjax.cli import main


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    write_curved(tmp_path / "a.drive.h5")
    return tmp_path / "a.drive.h5"


def test_there_and_back(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording, again = drive.with_name("a.mcap"), drive.with_name("b.drive.h5")
    assert run("export", drive, "-o", recording) == 0
    assert capsys.readouterr().out == (
        f"wrote {recording}: 300 scans\nnot exported, as there are no messages for them: truth, vehicle\n"
    )
    assert run("import", "mcap", recording, "-o", again) == 0
    place, wrote = capsys.readouterr().out.splitlines()
    assert place.startswith("place: 33.9000 S, 70.6000 W; extent: ")
    assert wrote == f"wrote {again}"
    assert run("check", again) == 0
    # Neither replaces an output unasked.
    capsys.readouterr()
    before = recording.read_bytes(), again.read_bytes()
    assert run("export", drive, "-o", recording) == 1
    assert run("import", "mcap", recording, "-o", again) == 1
    assert capsys.readouterr().err.count("or --force") == 2
    assert (recording.read_bytes(), again.read_bytes()) == before
    assert run("export", drive, "-o", recording, "--force") == 0
    assert run("import", "mcap", recording, "-o", again, "--force") == 0


def test_options_reach_the_drive_and_notes_the_user(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    messages = [each for each in rover_messages() if each[0] != "/rover/imu"]
    path = write_recording(tmp_path / "rover.mcap", messages)
    command = ("import", "mcap", path, "-o", tmp_path / "x.drive.h5")
    assert run(*command) == 1
    assert "or --channel-pitch-m, found neither for 2 channels" in capsys.readouterr().err
    options = ("--channel-pitch-m", 0.2, "--array-height-m", 0.3, "--gnss-m", 1, 0, 1.5)
    assert run(*command, *options) == 0
    assert "heading from the path" in capsys.readouterr().out
    topics = ("--radar-topic", "/rover/gpr", "--gnss-topic", "/rover/gps", "--odometry-topic", "/rover/odom")
    asked = (*topics, "--heading-topic", "/rover/odom", "--heading-sigma-deg", 2)
    assert run(*command, *options, *asked, "--force") == 0
    assert "heading from the path" not in capsys.readouterr().out
    assert run(*command, *options, "--gnss-sigma-m", -1) == 2
    assert "--gnss-sigma-m: expected a number above zero, found -1" in capsys.readouterr().err


def test_bad_input_is_one_line(drive: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output, wrong, none = drive.with_name("y.mcap"), drive.with_name("x.mcap"), drive.with_name("no.fixes.h5")
    log = drive.with_name("y.drive.h5")
    wrong.write_bytes(b"GIF89a")
    commands: dict[str, tuple[object, ...]] = {
        "x.mcap: file: expected an MCAP file, found another": ("import", "mcap", wrong, "-o", log),
        "x.mcap: file: expected an HDF5 file": ("export", wrong, "-o", output),
        "no.fixes.h5: file: expected a readable file": ("export", drive, "--fixes", none, "-o", output),
    }
    before = sorted(drive.parent.iterdir())
    for words, command in commands.items():
        assert run(*command) == 1
        error = capsys.readouterr().err
        assert words in error
        assert len(error.strip().splitlines()) == 1
    assert run("export", drive, "-o", drive.with_name("y.csv")) == 2
    assert "ends in .mcap, .bag, .db3, .tum" in capsys.readouterr().err
    assert sorted(drive.parent.iterdir()) == before


@pytest.mark.parametrize("verb", ["export", "import"])
def test_the_package_that_is_missing_is_named(
    verb: str, drive: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = write_recording(drive.with_name("r.mcap"), rover_messages(5))
    for name in [name for name in sys.modules if name == "mcap" or name.startswith("mcap.")]:
        monkeypatch.setitem(sys.modules, name, None)
    command: tuple[object, ...] = ("export", drive, "-o", drive.with_name("x.mcap"))
    if verb == "import":
        command = ("import", "mcap", recording, "-o", drive.with_name("x.drive.h5"))
    assert run(*command) == 1
    assert "expected the optional package mcap (pip install lgprjax[log]), found none" in capsys.readouterr().err


def test_a_full_disk_is_one_line_and_leaves_nothing(drive: Path) -> None:
    """Files may grow to 6 kB and no further, as on a disk that fills up."""
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (6_000, 6_000))"
    words = ["export", str(drive), "-o", str(drive.with_name("x.mcap"))]
    code = f"{limit}; from lgprjax.cli import main; main({words!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "File too large" in done.stderr
    assert [each.name for each in drive.parent.iterdir()] == ["a.drive.h5"]


@pytest.mark.parametrize(("verb", "words"), [(("export",), "X.fixes.h5"), (("import", "mcap"), "--heading-topic")])
def test_help(verb: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*verb, "--help") == 0
    text = capsys.readouterr().out
    assert words in text
    assert "lgprjax[log]" in text
