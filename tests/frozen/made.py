"""A small site located in two ways, and files of every kind that comes cheaply."""

import shutil
from pathlib import Path

import pandas as pd

from frozen.harness import DATA, ROOT, run_commands
from frozen.recordings import lay_out

LOCATED = ("default/live", "default/rain", "default/impostor", "forced/live")
"""Folder and drive of each table: by default, which takes windows of 0 to 4 m here and finds the time scale; forced."""
COLUMNS = (
    *("scan", "code", "latitude_deg", "longitude_deg", "height_m", "heading_deg", "sigma_along_m", "sigma_cross_m"),
    *("correlation", "time_scale", "window_m"),
)
_COMMANDS = [
    "simulate site.toml -o drives",
    "map build drives/left.drive.h5 drives/right.drive.h5 -o m.map.h5",
    "register m.map.h5 drives/live.drive.h5 drives/rain.drive.h5 drives/impostor.drive.h5 -o default"
    " --workers 1 --threads 1",
    "register m.map.h5 drives/live.drive.h5 -o forced --window-m 2 --time-scale 1 --search-m 1",
    "simulate vehicle.toml -o vehicle --only straight",
    "map info m.map.h5 --json info.json",
    "check m.map.h5 drives/live.drive.h5 default/live.fixes.h5 --json check.json",
    "route select m.map.h5 left -o r.route.toml",
    "export drives/live.drive.h5 --fixes default/live.fixes.h5 -o live.mcap",
    "import mcap live.mcap -o again.drive.h5",
    "cover plan field.geojson -o p.cover.geojson --vehicle flail.vehicle.toml",
    "cover record field/run --plan field/field.cover.geojson -o f.worked.h5 --json worked.json",
]


def make_all(folder: Path) -> None:
    """Make everything in an empty folder."""
    shutil.copyfile(DATA / "site.toml", folder / "site.toml")
    shutil.copyfile(ROOT / "tuning" / "drives.toml", folder / "vehicle.toml")
    shutil.copyfile(ROOT / "onboard" / "field.geojson", folder / "field.geojson")
    shutil.copyfile(ROOT / "onboard" / "made_up_flail.vehicle.toml", folder / "flail.vehicle.toml")
    lay_out("field", folder / "field")
    run_commands([command.split() for command in _COMMANDS], folder)


def fixes_of(folder: Path) -> pd.DataFrame:
    """The columns of every table of fixes that are compared, one table under the other."""
    tables = []
    for name in LOCATED:
        table = pd.read_csv(folder / f"{name}.fixes.csv")[list(COLUMNS)]
        table.insert(0, "of", name)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
