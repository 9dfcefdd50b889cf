"""``lgprjax map update`` in processes of its own: several at once, killed at any moment, with a full disk."""

import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import lgprjax as lx
from canon.commands import Done
from canon.trench import TrenchSite
from lgprjax.formats import MapFile, check_file
from refusals import printed_refusal, refused

ROOT = Path(__file__).parents[2]


def started(*arguments: object, first: str = "") -> subprocess.Popen[str]:
    """A command in a process of its own, that does something first."""
    words = [str(a) for a in ("map", "update", *arguments)]
    code = f"{first}\nfrom lgprjax.cli import main\nmain({words!r})"
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT
    )


def ended(process: subprocess.Popen[str]) -> Done:
    out, err = process.communicate(timeout=600)
    return Done(process.returncode, out, err)


def test_the_same_is_said_in_python(trench: TrenchSite, tmp_path: Path) -> None:
    with lx.open_map(trench.map) as site:
        updated = site.update(trench.newer[0], tmp_path / "new.map.h5")
        refined = site.refine(tmp_path / "agreed.map.h5")
        with refused("output", "force=True", file=tmp_path / "agreed.map.h5"):
            site.refine(tmp_path / "agreed.map.h5")
    with updated.map, refined.map:
        assert (updated.map.baselines, refined.map.baselines) == (3, 2)
        assert updated.table["name"].tolist() == ["newer1"]
        assert updated.table["changed"].tolist() == [2]
        assert repr(updated).startswith("ChangedMap: Map 'road': ")
        assert refined.table["baseline"].tolist() == [0, 1]
        assert (refined.table["moved_max_m"] < 0.2).all()
    assert check_file(refined.map.path) == []


def test_two_processes_lose_no_update(trench: TrenchSite, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, path)
    both = [started(path, drive) for drive in trench.newer[:2]]
    ends = [ended(process) for process in both]
    done = [drive for drive, end in zip(trench.newer, ends, strict=False) if end.status == 0]
    for end in ends:
        if end.status:
            # A progress bar may stand on standard error too; the reason is one line.
            (line,) = [line for line in end.err.splitlines() if line.startswith("lgprjax: ")]
            assert (end.status, printed_refusal(line).file) == (1, str(path))
    assert done
    with MapFile.open(path) as source:
        inputs = source.provenance["inputs"]
    assert isinstance(inputs, list)
    assert [row["file"] for row in inputs[2:]] == [drive.name for drive in done]
    assert check_file(path) == []
    assert list(tmp_path.iterdir()) == [path]


def test_killed_at_twenty_moments(trench: TrenchSite, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, path)
    began = time.monotonic()
    assert ended(started(path, trench.newer[0], "-o", tmp_path / "new.map.h5")).status == 0
    took_s = time.monotonic() - began
    (tmp_path / "new.map.h5").unlink()
    before, rng = path.read_bytes(), random.Random(2)
    for number in range(20):
        process = started(path, trench.newer[0])
        # Half of the kills in the last third, where files are written.
        time.sleep(took_s * (rng.uniform(0.0, 1.0) if number % 2 else rng.uniform(0.67, 0.98)))
        process.kill()
        if ended(process).status == 0:
            shutil.copyfile(trench.map, path)
        assert check_file(path) == []
        assert path.read_bytes() == before
    last = ended(started(path, trench.newer[0]))
    assert last.status == 0, last.err
    assert check_file(path) == []
    assert list(tmp_path.iterdir()) == [path]


def test_a_full_disk_in_a_process_of_its_own(trench: TrenchSite, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, path)
    before = path.read_bytes()
    limit = len(before) // 2
    full = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))"
    done = ended(started(path, trench.newer[0], first=full))
    assert done.status == 1
    (line,) = [line for line in done.err.splitlines() if line.startswith("lgprjax: ")]
    printed_refusal(line).check("output", file=path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]
