"""Starts on a map without a prior position: found in place, refused on other ground, several where ground repeats."""

import csv
import shutil
from collections.abc import Callable
from functools import cache
from pathlib import Path

import h5py
import numpy as np
import pytest

import lgprjax as lx
from batch.other_days import drive_over, village
from canon.commands import run, succeed
from canon.map import of_many_grounds
from canon.site import Site
from lgprjax.batch.locate import COLUMNS, LocatedDrive, MapLines, locate_log
from lgprjax.batch.register import true_poses
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.scene import WEATHER


@pytest.fixture(scope="module")
def begun(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[LocatedDrive, Path]]:
    """Starts every twelve metres of a clear day, one of snow, one in the opposite direction; one of other ground."""
    folder = tmp_path_factory.mktemp("starts")

    @cache
    def located(day: str) -> tuple[LocatedDrive, Path]:
        path = site.logs[day] if day in site.logs else folder / f"{day}.drive.h5"
        if day not in site.logs:
            weather, direction = {"snow": ("snow", 1), "back": ("clear", -1)}[day]
            drive_over(village(), path, WEATHER[weather](7), direction=direction)
        with MapFile.open(site.map) as source, DriveLog.open(path) as log:
            return locate_log(MapLines(source), log, None if day == "impostor" else 12.0), path

    return located


def off_m(site: Site, found: LocatedDrive, path: Path) -> np.ndarray:
    """Distance of the located places from the truth."""
    ok = found.table[found.table["code"] == "ok"]
    with MapFile.open(site.map) as source, DriveLog.open(path) as log:
        frame = source.description.frame
        truth = true_poses(log, frame)
        assert truth is not None
        latitude, longitude = ok[["latitude_deg", "longitude_deg"]].to_numpy().T
        east, north, _ = frame.to_local(latitude, longitude, np.zeros(len(ok)))
        true_m = truth[ok["scan"].to_numpy()]
        return np.asarray(np.hypot(np.asarray(east) - true_m[:, 0], np.asarray(north) - true_m[:, 1]))


@pytest.mark.parametrize("day", [*(pytest.param(day, marks=pytest.mark.long) for day in ("live", "snow")), "back"])
def test_starts_are_found_within_metres(
    site: Site, begun: Callable[[str], tuple[LocatedDrive, Path]], day: str
) -> None:
    """Against the baselines' direction, too: the heading is that of the drive."""
    found, path = begun(day)
    table = found.table
    assert tuple(table.columns) == COLUMNS
    ok = (table["code"] == "ok").to_numpy()
    # The last start may have too little of the drive ahead of it.
    assert ok[:-1].all()
    assert table["driven_m"][ok].median() < 5.0
    assert off_m(site, found, path).max() < 0.3
    with MapFile.open(site.map) as source, DriveLog.open(path) as log:
        truth = true_poses(log, source.description.frame)
        assert truth is not None
        yaw = source.description.frame.yaw_of_heading(
            table["heading_deg"][ok].to_numpy(), table["longitude_deg"][ok].to_numpy()
        )
    turned = np.cos(np.asarray(yaw) - truth[table["scan"][ok], 3])
    assert turned.min() > np.cos(np.radians(5.0))


def test_positions_of_the_log_are_not_looked_at(site: Site, tmp_path: Path) -> None:
    """A hundred kilometres away, the same start is found."""
    moved = tmp_path / "moved.drive.h5"
    shutil.copy(site.logs["live"], moved)
    with h5py.File(moved, "r+") as store:
        store["gnss_ins/latitude_deg"][:] += 1.0
    with MapFile.open(site.map) as source:
        held, rows = MapLines(source), []
        for path in (site.logs["live"], moved):
            with DriveLog.open(path) as log:
                rows.append(locate_log(held, log).table.iloc[0])
    assert rows[1]["code"] == "ok"
    for column in ("scan", "latitude_deg", "longitude_deg"):
        assert rows[0][column] == pytest.approx(rows[1][column], abs=2e-6)


def test_other_ground_is_no_start(begun: Callable[[str], tuple[LocatedDrive, Path]]) -> None:
    table = begun("impostor")[0].table
    assert not (table["code"] == "ok").any()
    assert table["p_false"].min() > 1e-2
    assert table["latitude_deg"].isna().all()


def test_ground_that_is_mapped_twice_stays_ambiguous(site: Site, tmp_path: Path) -> None:
    """The same recording at two places: two hypotheses, each as likely."""
    twin = tmp_path / "twin.drive.h5"
    shutil.copy(site.logs["baseline_left"], twin)
    with h5py.File(twin, "r+") as store:
        for group in ("gnss_ins", "truth"):
            if group in store:
                store[f"{group}/latitude_deg"][:] += 2e-3
    database = tmp_path / "twice.map.h5"
    build_map([site.logs["baseline_left"], twin], database, measure=of_many_grounds)
    found = lx.locate(database, site.logs["live"])
    row = found.table.iloc[0]
    assert row["code"] == "ambiguous"
    assert row["hypotheses"] == 2
    assert row["p_false"] == pytest.approx(0.5, abs=0.35)


def test_the_command_writes_a_row_per_start(site: Site, tmp_path: Path) -> None:
    live, out = site.logs["live"], tmp_path / "out"
    said = succeed("locate", site.map, live, "-o", out, "--every-m", 15)
    assert "starts located" in said
    with (out / "live.located.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert rows[0]["code"] == "ok"
    assert float(rows[0]["p_false"]) < 1e-6
    assert run("locate", site.map, live, "-o", out).status == 1
    assert run("locate", site.map, live, "-o", tmp_path / "other", "--every-m", 0).status == 2
    succeed("locate", site.map, live, "-o", out, "--force")


def test_what_is_no_distance_is_refused(site: Site) -> None:
    with pytest.raises(InputError) as refused:
        lx.locate(site.map, site.logs["live"], every_m=-1.0)
    assert refused.value.place == "every_m"
