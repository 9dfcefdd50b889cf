"""``lgprjax map update`` as a person meets it, and as several processes at once."""

import json
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import lgprjax as lx
from canon.trench import TrenchSite, first_scans
from lgprjax.cli import main
from lgprjax.errors import InputError
from lgprjax.formats import MapFile, check_file

ROOT = Path(__file__).parents[2]


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


def started(*arguments: object) -> subprocess.Popen[str]:
    """A command in a process of its own."""
    words = [str(a) for a in ("map", "update", *arguments)]
    code = f"from lgprjax.cli import main; main({words!r})"
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )


def test_what_it_says(trench: TrenchSite, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    new, figures = tmp_path / "new.map.h5", tmp_path / "figures.json"
    assert run("map", "update", trench.map, trench.newer[0], "-o", new, "--json", figures) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "newer1: baseline 2, 22 m" in said
    assert "changed or disturbed, against left (matches 0." in said
    assert "nothing is retired" in said
    assert "stations are held back" in said
    assert f"wrote {new}" in said
    told = json.loads(figures.read_text())
    (drive,) = told["drives"]
    assert drive["name"] == "newer1"
    assert [each["baseline"] for each in drive["changed"]] == [0, 1]
    assert [row["file"] for row in told["weights"]] == ["left", "right", "newer1"]
    assert check_file(new) == []
    with MapFile.open(new) as source, MapFile.open(trench.map) as old:
        assert source.chance is not None
        assert old.chance is not None
        assert source.chance.pieces != old.chance.pieces or not np.array_equal(source.chance.start, old.chance.start)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["figures.json", "new.map.h5"]


@pytest.mark.campaign
def test_the_same_is_said_in_python(trench: TrenchSite, tmp_path: Path) -> None:
    with lx.open_map(trench.map) as site:
        updated = site.update(trench.newer[0], tmp_path / "new.map.h5")
        refined = site.refine(tmp_path / "agreed.map.h5")
        with pytest.raises(InputError, match="expected a new file, or force=True"):
            site.refine(tmp_path / "agreed.map.h5")
    with updated.map, refined.map:
        assert (updated.map.baselines, refined.map.baselines) == (3, 2)
        assert updated.table["name"].tolist() == ["newer1"]
        assert updated.table["changed"].tolist() == [2]
        assert any("changed or disturbed, against left (matches 0." in note for note in updated.notes)
        assert repr(updated).startswith("ChangedMap: Map 'road': ")
        assert refined.table["baseline"].tolist() == [0, 1]
        assert (refined.table["moved_max_m"] < 0.2).all()
        assert "places tried on earlier passes" in refined.notes[0]
    assert check_file(refined.map.path) == []


def test_bad_input_is_one_line(trench: TrenchSite, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = first_scans(trench.newer[1], tmp_path / "short.drive.h5", 100)
    map_path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, map_path)
    before = map_path.read_bytes()
    for arguments, expected in (
        ([map_path, short], "fixes: expected fixes that agree over 5 m"),
        ([map_path, tmp_path / "none.drive.h5"], "No such file"),
        ([tmp_path / "none.map.h5", short], "No such file"),
        ([tmp_path / "no" / "none.map.h5", short], "folder that exists"),
        ([map_path, trench.newer[0], trench.newer[0]], "one that is given twice"),
        ([map_path, trench.newer[0], "-o", map_path], "one that exists"),
    ):
        assert run("map", "update", *arguments) == 1
        said = capsys.readouterr().err.strip().splitlines()
        assert len(said) == 1
        assert expected in said[0]
    assert run("map", "update", map_path) == 2
    assert map_path.read_bytes() == before
    assert sorted(tmp_path.iterdir()) == [map_path, short]


@pytest.mark.campaign
def test_two_processes_lose_no_update(trench: TrenchSite, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, path)
    both = [started(path, drive) for drive in trench.newer[:2]]
    said = [process.communicate(timeout=600) for process in both]
    done = [drive for drive, process in zip(trench.newer, both, strict=False) if process.returncode == 0]
    refused = [err for process, (_, err) in zip(both, said, strict=True) if process.returncode == 1]
    for error in refused:
        # A progress bar may stand on standard error too; the reason is one line.
        assert sum("expected a map that no other process is writing" in line for line in error.splitlines()) == 1
    assert len(done) + len(refused) == 2
    assert done
    with MapFile.open(path) as source:
        inputs = source.provenance["inputs"]
    assert isinstance(inputs, list)
    assert [row["file"] for row in inputs[2:]] == [drive.name for drive in done]
    assert check_file(path) == []
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.campaign
def test_killed_at_twenty_moments(trench: TrenchSite, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, path)
    began = time.monotonic()
    whole = started(path, trench.newer[0], "-o", tmp_path / "new.map.h5")
    assert whole.wait(timeout=600) == 0
    whole.communicate()
    took_s = time.monotonic() - began
    (tmp_path / "new.map.h5").unlink()
    before, rng = path.read_bytes(), random.Random(2)
    for number in range(20):
        process = started(path, trench.newer[0])
        # Half of the kills in the last third, where files are written.
        time.sleep(took_s * (rng.uniform(0.0, 1.0) if number % 2 else rng.uniform(0.67, 0.98)))
        process.kill()
        process.communicate()
        if process.returncode == 0:
            shutil.copyfile(trench.map, path)
        assert check_file(path) == []
        assert path.read_bytes() == before
    last = started(path, trench.newer[0])
    _, error = last.communicate(timeout=600)
    assert last.returncode == 0, error
    assert check_file(path) == []
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.campaign
def test_a_full_disk_in_a_process_of_its_own(trench: TrenchSite, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, path)
    before = path.read_bytes()
    limit = len(before) // 2
    words = ["map", "update", str(path), str(trench.newer[0])]
    code = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))"
    done = subprocess.run(
        [sys.executable, "-c", f"{code}; from lgprjax.cli import main; main({words!r})"],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
    )
    assert done.returncode == 1
    assert f"lgprjax: {path}: output: expected a file that can be written, found File too large" in done.stderr
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
