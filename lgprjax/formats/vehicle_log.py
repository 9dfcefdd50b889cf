"""A drive log without its radar data, for calibrations, of drives with or without a radar."""

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.drive import (
    NavigationTrack,
    OdometryTrack,
    provenance_of,
    read_arrays,
    read_track,
    serial_number_of,
    without_invented,
    write_plan,
    write_signals,
    write_tracks,
)
from lgprjax.formats.fixes import read_fixes
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import (
    attribute_of,
    create_store,
    open_store,
    reading,
    utc_ns,
    validate_store,
    write_attribute,
)

_SCHEMA = load_schema("drive")


@dataclass(frozen=True)
class VehicleLog:
    """A drive without its radar data.

    Attributes:
        name: name of the drive.
        t0_utc: origin of every ``time_s``, ISO 8601.
        navigation: GNSS/INS poses, with sigmas.
        odometry: signed travel.
        truth: true poses, without sigmas, if known.
        vehicle: signals by their names in ``data_schema/drive.toml``, including ``time_s``; ``None`` without any.
        serial_number: serial number of the vehicle, ``None`` if the log names none.
        provenance: steps, parameters and inputs of the log; must be JSON.
        plan: decisions of the autopilot by name; ``None`` without any.
    """

    name: str
    t0_utc: str
    navigation: NavigationTrack
    odometry: OdometryTrack
    truth: NavigationTrack | None
    vehicle: dict[str, np.ndarray] | None
    serial_number: str | None
    provenance: dict[str, object]
    plan: dict[str, np.ndarray] | None = None

    @classmethod
    def open(cls, path: str | Path) -> "VehicleLog":
        """Read a drive log of any kind without its radar data; the file is closed again.

        Raises:
            InputError: the file is missing, damaged, of another format or of a newer major version, or anything except
                the radar data does not match ``data_schema/drive.toml``.
        """
        with open_store(path) as store:
            for finding in validate_store(store, path, _SCHEMA):
                if finding.severity == "error":
                    raise finding.error()
            with reading(path, "description"):
                truth, vehicle = store.get("/truth"), store.get("/vehicle")
                return cls(
                    name=str(attribute_of(store, "name")),
                    t0_utc=str(attribute_of(store, "t0_utc")),
                    navigation=without_invented(read_track(store["/gnss_ins"]), provenance_of(store)),
                    odometry=OdometryTrack(store["/odometry/time_s"][:], store["/odometry/distance_m"][:]),
                    truth=None if truth is None else read_track(truth),
                    vehicle=read_arrays(vehicle),
                    serial_number=serial_number_of(vehicle),
                    provenance=provenance_of(store),
                    plan=read_arrays(store.get("/plan")),
                )


def write_vehicle_log(path: str | Path, log: VehicleLog, *, force: bool = False) -> None:
    """Write a drive log without radar.

    Raises:
        InputError: the log does not match ``data_schema/drive.toml``, or the output exists (without ``force``) or
            cannot be written.
    """
    target = Path(path)
    with create_store(target, _SCHEMA, force) as (store, _):
        write_attribute(store, "name", log.name)
        write_attribute(store, "t0_utc", log.t0_utc)
        write_attribute(store, "provenance", json.dumps(log.provenance))
        write_tracks(store, log.navigation, log.odometry, log.truth)
        write_signals(store, target, log.vehicle, log.serial_number)
        write_plan(store, target, log.plan)
        for finding in validate_store(store, target, _SCHEMA):
            if finding.severity == "error":
                raise finding.error()


# Drive logs and fixes as pandas tables: indexed by UTC times, with units in the column names.

INDEX = "time_utc"


class DriveFrames(NamedTuple):
    """Tables of a drive. Each is indexed by its own UTC times; ``time_s`` counts from the drive's ``t0_utc``.

    Attributes:
        navigation: poses of the body origin by GNSS/INS, with sigmas.
        odometry: ``distance_m``, signed travel.
        scans: number of each scan, and how many of its channels are valid; empty of a drive without radar.
        truth: true poses; ``None`` if unknown.
        vehicle: signals of the vehicle; ``None`` without any.
        plan: decisions of the autopilot; ``None`` without any.
    """

    navigation: pd.DataFrame
    odometry: pd.DataFrame
    scans: pd.DataFrame
    truth: pd.DataFrame | None
    vehicle: pd.DataFrame | None
    plan: pd.DataFrame | None


def read_drive_frames(path: str | Path) -> DriveFrames:
    """Everything of a drive log except its radar data, as tables; ``attrs`` of each hold the drive's name and
    ``t0_utc``.

    Columns are those of ``data_schema/drive.toml``. The radar data of some scans is ``DriveLog.read_traces``.

    Raises:
        InputError: the file is missing, damaged or does not match the schema.
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
    """Fixes of ``X.fixes.h5`` as a table indexed by the UTC times of their scans; ``attrs`` are the file's own.

    Raises:
        InputError: the file is missing, damaged, does not match the schema, or has no origin of its times
            (``X.fixes.csv`` has none).
    """
    table = read_fixes(path)
    try:
        index = moments(str(table.attrs["t0_utc"]), table["time_s"].to_numpy())
    except (KeyError, ValueError):
        expected = "the origin of its times, as in X.fixes.h5"
        raise InputError(path, "@t0_utc", expected, str(table.attrs.get("t0_utc", "none"))) from None
    attributes = dict(table.attrs)
    table = table.set_index(index)
    table.attrs = attributes
    return table


def moments(t0_utc: str, time_s: Float[np.ndarray, " row"]) -> pd.DatetimeIndex:
    """UTC times, to the nanosecond, of seconds since ``t0_utc``. Raises ``ValueError`` if that is invalid."""
    whole_ns = utc_ns(t0_utc) + np.rint(1e9 * time_s).astype(np.int64)
    return pd.DatetimeIndex(whole_ns.astype("datetime64[ns]"), name=INDEX).tz_localize("UTC")
