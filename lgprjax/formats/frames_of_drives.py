"""Drive logs and fixes as pandas tables: an index of moments in UTC, columns that carry their units."""

from dataclasses import fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.drive_description import NavigationTrack
from lgprjax.formats.fixes import read_fixes
from lgprjax.formats.store import open_store, reading
from lgprjax.formats.utc import utc_ns
from lgprjax.formats.vehicle_log import VehicleLog

INDEX = "time_utc"


class DriveFrames(NamedTuple):
    """Tables of a drive. Each is indexed by its own moments in UTC; ``time_s`` counts from the drive's ``t0_utc``.

    Attributes:
        navigation: poses of the body origin by GNSS/INS, with sigmas.
        odometry: ``distance_m``, signed travel.
        scans: number of each scan, and how many of its channels are valid; empty of a drive without radar.
        truth: true poses; ``None`` where they are not known.
        vehicle: signals of the vehicle; ``None`` where there are none.
        plan: what the autopilot decided; ``None`` where there is nothing.
    """

    navigation: pd.DataFrame
    odometry: pd.DataFrame
    scans: pd.DataFrame
    truth: pd.DataFrame | None
    vehicle: pd.DataFrame | None
    plan: pd.DataFrame | None


def read_drive_frames(path: str | Path) -> DriveFrames:
    """Everything of a drive log but its radar data, as tables; ``attrs`` of each hold the drive's name and ``t0_utc``.

    Columns are those of ``data_schema/drive.toml``. The radar data of some scans is ``DriveLog.read_traces``.

    Raises:
        InputError: the file is missing, damaged or not as the schema says.
    """
    log = VehicleLog.open(path)

    def table(columns: dict[str, np.ndarray]) -> pd.DataFrame:
        frame = pd.DataFrame(columns, index=moments(log.t0_utc, columns["time_s"]))
        frame.attrs = {"name": log.name, "t0_utc": log.t0_utc}
        return frame

    def track(poses: NavigationTrack) -> pd.DataFrame:
        values = {field.name: getattr(poses, field.name) for field in fields(poses)}
        return table({name: each for name, each in values.items() if each is not None})

    def signals(arrays: dict[str, np.ndarray] | None) -> pd.DataFrame | None:
        return None if arrays is None else table({"time_s": arrays["time_s"], **arrays})

    with open_store(path) as store, reading(path, "/radar"):
        time_s = store["/radar/time_s"][:] if "/radar" in store else np.zeros(0)
        channels = len(store["/array/y_m"]) if "/radar" in store else 0
        valid = store["/radar/valid"][:].astype(bool).sum(axis=1) if "/radar/valid" in store else channels
    scans = {"scan": np.arange(len(time_s)), "time_s": time_s, "valid_channels": np.broadcast_to(valid, time_s.shape)}
    return DriveFrames(
        navigation=track(log.navigation),
        odometry=table({"time_s": log.odometry.time_s, "distance_m": log.odometry.distance_m}),
        scans=table(scans),
        truth=None if log.truth is None else track(log.truth),
        vehicle=signals(log.vehicle),
        plan=signals(log.plan),
    )


def read_fixes_frame(path: str | Path) -> pd.DataFrame:
    """Fixes of ``X.fixes.h5`` as a table indexed by the moments of their scans; ``attrs`` are the file's own.

    Raises:
        InputError: the file is missing, damaged, not as the schema says, or does not tell the moment that its times
            count from (``X.fixes.csv`` does not).
    """
    table = read_fixes(path)
    try:
        index = moments(str(table.attrs["t0_utc"]), table["time_s"].to_numpy())
    except (KeyError, ValueError):
        expected = "the moment that times count from, as X.fixes.h5 has it"
        raise InputError(path, "@t0_utc", expected, str(table.attrs.get("t0_utc", "none"))) from None
    attributes = dict(table.attrs)
    table = table.set_index(index)
    table.attrs = attributes
    return table


def moments(t0_utc: str, time_s: Float[np.ndarray, " row"]) -> pd.DatetimeIndex:
    """Moments, to the nanosecond, of times that count from ``t0_utc``. Raises ``ValueError`` where that is none."""
    whole_ns = utc_ns(t0_utc) + np.rint(1e9 * time_s).astype(np.int64)
    return pd.DatetimeIndex(whole_ns.astype("datetime64[ns]"), name=INDEX).tz_localize("UTC")
