"""``lgprjax map refine``: what it prints, writes and refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from canon.commands import run, succeed
from lgprjax.formats import MapFile
from plane_ground import STEP_M, write_plane_map


def test_two_baselines_of_a_road(tmp_path: Path) -> None:
    """Labels that differ by 6 cm across are made to agree, halfway."""
    at_m = np.arange(0.0, 15.0, STEP_M)
    truth = [np.stack([at_m, np.full_like(at_m, aside_m), np.zeros_like(at_m)], axis=1) for aside_m in (0.0, 0.1)]
    map_path, output, figures = (tmp_path / name for name in ("m.map.h5", "agreed.map.h5", "agreed.json"))
    write_plane_map(map_path, truth, [truth[0], truth[1] + [0.0, 0.06, 0.0]])
    assert f"wrote {output}" in succeed("map", "refine", map_path, "-o", output, "--json", figures)
    written = json.loads(figures.read_text())
    assert written["believed"] > 0.9 * written["used"] > 5
    assert written["after"]["rms_m"] < 0.3 * written["before"]["rms_m"]
    with MapFile.open(output) as refined, MapFile.open(map_path) as source:
        assert refined.provenance["inputs"] == source.provenance["inputs"]
        moved_m = (refined.pose - source.pose)[:, 1]
    moved = [float(np.median(moved_m[: len(at_m)])), float(np.median(moved_m[len(at_m) :]))]
    assert moved == pytest.approx([0.03, -0.03], abs=0.02)
    # What is there is not replaced, and is refused before any work.
    run("map", "refine", map_path, "-o", output).refusal.check("output", "--force", file=output)


def test_one_baseline_has_nothing_to_agree_with(tmp_path: Path) -> None:
    at_m = np.arange(0.0, 15.0, STEP_M)
    pose = np.stack([at_m, np.zeros_like(at_m), np.zeros_like(at_m)], axis=1)
    lone, output = tmp_path / "lone.map.h5", tmp_path / "agreed.map.h5"
    write_plane_map(lone, [pose], [pose])
    succeed("map", "refine", lone, "-o", output, "--json", tmp_path / "lone.json")
    written = json.loads((tmp_path / "lone.json").read_text())
    assert written["tried"] == 0
    assert written["baselines"][0]["sigma_after_m"] is None
    with MapFile.open(output) as refined, MapFile.open(lone) as source:
        np.testing.assert_allclose(refined.pose, source.pose, atol=1e-4)
        # 15 m of one line are too little to tell.
        assert refined.chance is not None
        assert not refined.chance.own


def test_a_map_that_is_none_is_bad_input(tmp_path: Path) -> None:
    broken = tmp_path / "broken.map.h5"
    broken.write_bytes(b"not a map")
    done = run("map", "refine", broken, "-o", tmp_path / "agreed.map.h5")
    assert done.status == 1
    done.refusal.check("file", "HDF5", file=broken)
    assert [path.name for path in tmp_path.iterdir()] == ["broken.map.h5"]
