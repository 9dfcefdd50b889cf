"""What a command reads it never replaces, and other inputs that were taken for what they are not."""

import shutil
from pathlib import Path

import pytest

from canon.site import Site
from lgprjax.cli import main


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


@pytest.mark.parametrize(
    "command",
    [
        "map build M -o M",
        "check X --json X",
        "register M X -o out --json X",
        "register M X -o out --json M",
        "map info M --json M",
        "route list M --json M",
        "export X -o X",
        "map refine M -o M",
        "map update M X --json M",
    ],
)
def test_no_command_replaces_what_it_reads(
    command: str, site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drive, database = tmp_path / "x.drive.h5", tmp_path / "m.map.h5"
    shutil.copyfile(site.logs["live"], drive)
    shutil.copyfile(site.map, database)
    before = drive.read_bytes(), database.read_bytes()
    words = [{"X": drive, "M": database, "out": tmp_path / "out"}.get(word, word) for word in command.split()]
    assert run(*words, "--force") == 1
    told = capsys.readouterr().err
    assert len(told.strip().splitlines()) == 1
    assert "output: expected another file than those that are read, found one of them" in told
    assert (drive.read_bytes(), database.read_bytes()) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["m.map.h5", "x.drive.h5"]


def test_a_drive_is_a_baseline_once(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    again = tmp_path / "again.drive.h5"
    shutil.copyfile(site.logs["baseline_left"], again)
    assert run("map", "build", site.logs["baseline_left"], again, "-o", tmp_path / "m.map.h5") == 1
    told = capsys.readouterr().err
    assert "again.drive.h5: drives: expected each drive once, found the contents of " in told
    assert not (tmp_path / "m.map.h5").exists()


@pytest.mark.parametrize("suffix", ["tum", "mcap", "geojson"])
def test_fixes_of_another_drive_are_not_exported(
    suffix: str, site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two drives of one site have the same times and as many scans: their files tell them apart."""
    for name in ("live", "impostor"):
        shutil.copyfile(site.logs[name], tmp_path / f"{name}.drive.h5")
    folder = tmp_path / "result"
    assert run("register", site.map, tmp_path / "live.drive.h5", "-o", folder) == 0
    fixes = folder / "live.fixes.h5"
    capsys.readouterr()
    assert run("export", tmp_path / "live.drive.h5", "--fixes", fixes, "-o", tmp_path / f"right.{suffix}") == 0
    capsys.readouterr()
    assert run("export", tmp_path / "impostor.drive.h5", "--fixes", fixes, "-o", tmp_path / f"wrong.{suffix}") == 1
    told = capsys.readouterr().err
    assert (
        "live.fixes.h5: provenance: expected fixes of impostor.drive.h5, as it is now, found those of another" in told
    )
    assert not (tmp_path / f"wrong.{suffix}").exists()
