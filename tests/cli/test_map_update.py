"""``lgprjax map update`` as a person meets it. Several processes at once: ``validation/drives``."""

import json
import shutil
from pathlib import Path

import numpy as np

from canon.commands import run, succeed
from canon.trench import TrenchSite, first_scans
from lgprjax.formats import MapFile, check_file


def test_what_it_says(trench: TrenchSite, tmp_path: Path) -> None:
    new, figures = tmp_path / "new.map.h5", tmp_path / "figures.json"
    said = " ".join(succeed("map", "update", trench.map, trench.newer[0], "-o", new, "--json", figures).split())
    assert "newer1: baseline 2, 22 m" in said
    assert f"result: wrote {new}: 1 baseline added" in said
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


def test_bad_input_is_one_line(trench: TrenchSite, tmp_path: Path) -> None:
    short = first_scans(trench.newer[1], tmp_path / "short.drive.h5", 100)
    map_path = tmp_path / "road.map.h5"
    shutil.copyfile(trench.map, map_path)
    before = map_path.read_bytes()
    for words, file, place in (
        ([map_path, short], short, "fixes"),
        ([map_path, tmp_path / "none.drive.h5"], tmp_path / "none.drive.h5", "file"),
        ([tmp_path / "none.map.h5", short], tmp_path / "none.map.h5", "file"),
        ([tmp_path / "no" / "none.map.h5", short], tmp_path / "no" / "none.map.h5", "output"),
        ([map_path, trench.newer[0], trench.newer[0]], trench.newer[0], "drives"),
        ([map_path, trench.newer[0], "-o", map_path], map_path, "output"),
    ):
        done = run("map", "update", *words)
        assert done.status == 1
        done.refusal.check(place, file=file)
    assert run("map", "update", map_path).status == 2
    assert map_path.read_bytes() == before
    assert sorted(tmp_path.iterdir()) == [map_path, short]
