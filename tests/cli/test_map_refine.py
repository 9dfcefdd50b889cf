"""``lgprjax map refine``: what it prints, writes and refuses."""

import json
from pathlib import Path

import numpy as np

from canon.commands import run, succeed
from canon.site import Site
from lgprjax.formats import MapFile
from plane_ground import STEP_M, write_plane_map


def test_two_baselines_of_a_road(site: Site, tmp_path: Path) -> None:
    """Their labels are right to a centimetre: hardly anything moves."""
    output, figures = tmp_path / "agreed.map.h5", tmp_path / "agreed.json"
    assert f"wrote {output}" in succeed("map", "refine", site.map, "-o", output, "--json", figures)
    written = json.loads(figures.read_text())
    assert written["believed"] > 0.9 * written["used"] > 20
    assert all(row["moved_max_m"] < 0.05 for row in written["baselines"])
    assert written["after"]["rms_m"] <= written["before"]["rms_m"] < 0.06
    with MapFile.open(output) as refined, MapFile.open(site.map) as source:
        assert refined.provenance["inputs"] == source.provenance["inputs"]
        assert np.abs(refined.pose - source.pose).max() < 0.05
        # The ground has moved: its chance is measured anew.
        assert refined.chance is not None
        assert refined.chance.own
    # What is there is not replaced, and is refused before any work.
    run("map", "refine", site.map, "-o", output).refusal.check("output", "--force", file=output)


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
