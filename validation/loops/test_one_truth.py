"""One truth on board and off: of traces, and of sweeps whose receiver drifts by 20 % within each drive."""

from pathlib import Path

import pytest

from canon.map import of_many_grounds
from canon.site import Site
from lgprjax.mapping import build_map
from lgprjax.simulation import plan_drive, prepare_site, read_site, write_drive
from validation.loops.searched_run import check_off_board, check_one_truth, searched_run

SITES = Path(__file__).resolve().parents[2] / "sites"
_SCANS = 500


def swept_site(folder: Path) -> Site:
    """The site of a stepped-frequency radar."""
    scene = prepare_site(read_site(SITES / "array_sweeps.toml"))
    logs = {drive.name: folder / f"{drive.name}.drive.h5" for drive in scene.site.drives if drive.other_ground is None}
    for drive in scene.site.drives:
        if drive.name in logs:
            write_drive(logs[drive.name], plan_drive(scene, drive), sweeps=scene.site.sweeps)
    database = folder / "swept.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], database, measure=of_many_grounds)
    return Site(folder, logs, database)


@pytest.mark.parametrize("radar", ["traces", "sweeps"])
def test_the_fixes_of_a_run_are_those_of_its_drive_log(site: Site, tmp_path: Path, radar: str) -> None:
    ground = site if radar == "traces" else swept_site(tmp_path)
    (tmp_path / "run").mkdir()
    run = tmp_path / "run" / "recorded"
    searched_run(ground, run, _SCANS)
    check_one_truth(ground, run, tmp_path / "run.drive.h5", _SCANS)
    check_off_board(ground, run, _SCANS)
