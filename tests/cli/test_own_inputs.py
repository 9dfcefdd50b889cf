"""What a command reads it never replaces, and other inputs that were taken for what they are not."""

import shutil
from pathlib import Path

import pytest

from canon.commands import run
from canon.site import Site
from canon.story import Story


def test_no_command_replaces_what_it_reads(site: Site, short: Path, tmp_path: Path) -> None:
    drive, database = tmp_path / "x.drive.h5", tmp_path / "m.map.h5"
    shutil.copyfile(short, drive)
    shutil.copyfile(site.map, database)
    before = drive.read_bytes(), database.read_bytes()
    for command in (
        *("map build M -o M", "check X --json X", "register M X -o out --json X", "register M X -o out --json M"),
        *(
            "map info M --json M",
            "route list M --json M",
            "export X -o X",
            "map refine M -o M",
            "map update M X --json M",
        ),
    ):
        words = [{"X": drive, "M": database, "out": tmp_path / "out"}.get(word, word) for word in command.split()]
        done = run(*words, "--force")
        assert done.status == 1, command
        done.refusal.check("output", file=words[-1])
        assert (drive.read_bytes(), database.read_bytes()) == before
        assert sorted(path.name for path in tmp_path.iterdir()) == ["m.map.h5", "x.drive.h5"]


def test_a_drive_is_a_baseline_once(short: Path, tmp_path: Path) -> None:
    again = tmp_path / "again.drive.h5"
    shutil.copyfile(short, again)
    done = run("map", "build", short, again, "-o", tmp_path / "m.map.h5")
    assert done.status == 1
    done.refusal.check("drives", file=again, found="short.drive.h5")
    assert not (tmp_path / "m.map.h5").exists()


@pytest.mark.parametrize("suffix", ["tum", "mcap", "geojson"])
def test_fixes_of_another_drive_are_not_exported(suffix: str, story: Story, tmp_path: Path) -> None:
    """Two drives of one site have the same times and as many scans: their files tell them apart."""
    fixes, output = story.folder / "default/live.fixes.h5", tmp_path / f"wrong.{suffix}"
    done = run("export", story.folder / "drives/rain.drive.h5", "--fixes", fixes, "-o", output)
    assert done.status == 1
    done.refusal.check("provenance", "rain.drive.h5", file=fixes)
    assert not output.exists()
