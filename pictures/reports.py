"""Pictures that the commands draw, made from the demonstration's site and from a real recording."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import verify_map
from lgprjax.mapping.survey import ground_passes, half_like_m
from lgprjax.registration import SEARCH_SWARM
from lgprjax.report import (
    MapPasses,
    draw_confidence,
    draw_line,
    draw_map_slices,
    draw_passes,
    draw_trajectory,
    stated_errors,
)
from lgprjax.report.registered import draw_drive
from lgprjax.report.views import stations_of_map, view_of_profile
from pictures.demo import DemoSite, Located

ROOT = Path(__file__).parents[1]
RECORDING = Path("gprpy_dune") / "FILE____032.DZT"
"""Example data of GPRPy, MIT licence, in the folder that LGPRJAX_REAL_DATA names."""
_LATER = "2026-11-22"
"""Day of the ages in the picture of passes: a picture does not change from day to day."""
_LATER_DAYS = 20_779.0


class NoDataError(RuntimeError):
    """The recording that a picture shows is not on this machine."""


def draw_radargram(path: Path) -> None:
    """Draw the real recording. Raises ``NoDataError`` without it."""
    folder = os.environ.get("LGPRJAX_REAL_DATA")
    if not folder or not (Path(folder) / RECORDING).exists():
        raise NoDataError(f"radargram.png shows {RECORDING} of LGPRJAX_REAL_DATA, which is not there")
    view = view_of_profile(
        Path(folder) / RECORDING, channel=None, raw=False, speed_m_per_ns=None, sample_interval_ns=None
    )
    draw_line(view, path, force=True)


def draw_slices(site: DemoSite, path: Path) -> None:
    """Draw time slices of the map."""
    draw_map_slices(stations_of_map(site.map), path, force=True)


def draw_live_trajectory(site: DemoSite, path: Path) -> None:
    """Draw the live drive as ``lgprjax demo`` does."""
    draw_trajectory(site.live.result, path, force=True)


def draw_wet_trajectory(site: DemoSite, path: Path) -> None:
    """Draw the wet drive, located by windows of 1 m, many of them declined."""
    draw_trajectory(site.wet(window_m=1.0).result, path, force=True)


def draw_live_confidence(site: DemoSite, path: Path) -> None:
    """Draw stated against true errors of the wet drive, of which some scans are declined."""
    results = [replace(site.wet(window_m=window_m).result, name=f"wet, {window_m:g} m") for window_m in (1.0, 2.0)]
    draw_confidence(stated_errors([site.live.result, *results]), path, force=True)


def draw_match(site: DemoSite, path: Path) -> None:
    """Draw the strips of one scan."""
    _draw_of_drive(site, site.live, "-match.png", path)


def draw_match_over_position(site: DemoSite, path: Path) -> None:
    """Draw the score of one scan over the search region."""
    _draw_of_drive(site, site.live, "-map.png", path)


def draw_swarm(site: DemoSite, path: Path) -> None:
    """Draw the particle swarm of one scan."""
    swarm = replace(site.live, options=replace(site.live.options, search_swarm=SEARCH_SWARM))
    _draw_of_drive(site, swarm, "-swarm.png", path)


def _draw_of_drive(site: DemoSite, located: Located, end: str, path: Path) -> None:
    folder = site.folder / ("drawn" if located.options.search_swarm is None else "drawn-swarm")
    drawn = folder / f"{located.drive.name}{end}"
    if not drawn.exists():
        folder.mkdir(exist_ok=True)
        with MapFile.open(site.map) as source, DriveLog.open(located.log) as log:
            draw_drive(located.result, located.drive, source, log, located.options, folder, True)
    shutil.copyfile(drawn, path)


def draw_ground(site: DemoSite, path: Path) -> None:
    """Draw passes and their ages over the map, as of a fixed day."""
    with MapFile.open(site.map) as source:
        health = verify_map(source)
        ground = ground_passes(source, health.survey.route)
        passes = MapPasses(
            name=health.name,
            at_m=ground.at_m,
            across_m=ground.across_m,
            passes=ground.passes,
            age_days=_LATER_DAYS - ground.newest_day,
            hole=ground.hole,
            half_like_m=half_like_m(health.survey, source.description.channel_pitch_m),
            today=_LATER,
        )
    draw_passes(passes, path, force=True)


def draw_map_verify(site: DemoSite, path: Path) -> None:
    """Draw the strips of ``lgprjax map verify``."""
    folder = site.folder / "verified"
    _command(["map", "verify", str(site.map), "-o", str(folder), "--force"])
    shutil.copyfile(folder / "strips.png", path)


def draw_look_ahead(folder: Path, path: Path) -> None:
    """Draw the sweep of ``lgprjax tune tuning/look_ahead.toml``, of the tuned vehicle."""
    text = (ROOT / "tuning" / "look_ahead.toml").read_text(encoding="utf-8")
    vehicle = ROOT / "tuning" / "tuned.vehicle.toml"
    study = folder / "look_ahead.toml"
    study.write_text(text.replace("../out/tuned/pedals/made_up.vehicle.toml", str(vehicle)), encoding="utf-8")
    _command(["tune", str(study), "-o", str(folder / "look_ahead"), "--force"])
    shutil.copyfile(folder / "look_ahead" / "look_ahead.look_ahead.png", path)


def _command(arguments: list[str]) -> None:
    """Run a command of this tree."""
    subprocess.run([sys.executable, "-m", "lgprjax", *arguments], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
