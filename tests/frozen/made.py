"""Tables of fixes of the story that ``canon.story`` makes."""

from pathlib import Path

import pandas as pd

LOCATED = ("default/live", "default/rain", "default/impostor", "forced/live")
"""Folder and drive of each table: by default, which takes windows of 0 to 4 m here and finds the time scale; forced."""
COLUMNS = (
    *("scan", "code", "latitude_deg", "longitude_deg", "height_m", "heading_deg", "sigma_along_m", "sigma_cross_m"),
    *("correlation", "time_scale", "window_m"),
)


def fixes_of(folder: Path) -> pd.DataFrame:
    """The columns of every table of fixes that are compared, one table under the other."""
    tables = []
    for name in LOCATED:
        table = pd.read_csv(folder / f"{name}.fixes.csv")[list(COLUMNS)]
        table.insert(0, "of", name)
        tables.append(table)
    return pd.concat(tables, ignore_index=True)
