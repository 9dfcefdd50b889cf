"""Twenty metres of works on several generated roads: what updates give back, and what they must not take."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from canon.trench import TrenchSite, make_trench_site, parts
from lgprjax.batch import register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import update_map
from lgprjax.registration import WRONG_M, Code, RegisterOptions

LENGTH_M = 70.0
TRENCH_M = (25.0, 45.0)


@pytest.mark.parametrize(("seed", "depth_m"), [(11, 2.0), (12, 2.0), (13, 1.2), (14, 1.2)])
def test_availability_recovers_after_two_newer_drives(seed: int, depth_m: float, tmp_path: Path) -> None:
    site = make_trench_site(tmp_path, seed, LENGTH_M, TRENCH_M, depth_m=depth_m, newer=3)
    path = tmp_path / "updated.map.h5"
    shutil.copyfile(site.map, path)
    rows = [_figures(site, path)]
    for drive in site.newer:
        (update,) = update_map(path, [drive]).drives
        print(f"  {update.name}: {update.retired} retired, {update.released} released, {update.held_back} held back")
        rows.append(_figures(site, path))
    for name, (inside, outside, wrong, rms) in zip(("before", "once", "twice", "thrice"), rows, strict=True):
        print(f"{seed}, {depth_m} m deep, {name}: ok {inside:.3f} in, {outside:.3f} out; {wrong} wrong; {rms:.3f} m")
    before, once, twice, thrice = rows
    for later in (once, twice, thrice):
        assert later[1] >= before[1] - 0.02
        assert later[2] <= before[2]
    assert twice[0] >= 0.9 * twice[1]
    assert thrice[0] >= 0.9 * thrice[1]


def test_the_trench_can_be_driven_again_and_nothing_else_is_lost(trench: TrenchSite, tmp_path: Path) -> None:
    """In windows that fit into the trench: longer ones bridge it."""
    once, twice = tmp_path / "once.map.h5", tmp_path / "twice.map.h5"
    update_map(trench.map, [trench.newer[0]], once)
    update_map(once, [trench.newer[1]], twice)
    short = RegisterOptions(window_m=1.0)
    before, between, after = (_figures(trench, path, short) for path in (trench.map, once, twice))
    assert before[0] < 0.2
    assert after[0] > 0.85
    assert between[1] >= before[1] - 0.02
    assert after[1] >= before[1] - 0.02
    assert before[2] == between[2] == after[2] == 0


def _figures(
    site: TrenchSite, map_path: Path, options: RegisterOptions | None = None
) -> tuple[float, float, int, float]:
    """Share of ok scans in the trench and outside, the first metres left out; wrong ones among all, and cross-track RMS
    of what is ok."""
    with MapFile.open(map_path) as source, DriveLog.open(site.live) as log:
        found = register_log(source, log, options or RegisterOptions())
    assert found.truth is not None
    along, ok = found.truth[:, 0], np.asarray(found.fix.code) == Code.OK
    inside, outside = parts(site, along)
    outside &= along > along[0] + 2.5
    off = (np.asarray(found.fix.pose)[:, :2] - found.truth[:, :2])[ok]
    wrong = int(np.sum(np.hypot(*off.T) > WRONG_M))
    return float(ok[inside].mean()), float(ok[outside].mean()), wrong, float(np.sqrt(np.mean(off[:, 1] ** 2)))
