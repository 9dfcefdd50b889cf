"""A drive log but for its radar data: what calibrations read, of drives with a radar and without."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lgprjax.formats.drive_description import NavigationTrack, OdometryTrack
from lgprjax.formats.drive_log import provenance_of, read_arrays, read_track, serial_number_of, without_invented
from lgprjax.formats.drive_writer import write_plan, write_signals, write_tracks
from lgprjax.formats.hdf5_output import create_store
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import attribute_of, open_store, reading, validate_store, write_attribute

_SCHEMA = load_schema("drive")


@dataclass(frozen=True)
class VehicleLog:
    """A drive without its radar data.

    Attributes:
        name: of the drive.
        t0_utc: moment that every ``time_s`` counts from, ISO 8601.
        navigation: GNSS/INS poses, with sigmas.
        odometry: signed travel.
        truth: true poses, without sigmas, where they are known.
        vehicle: signals by their names in ``data_schema/drive.toml``, ``time_s`` among them; ``None``: there are none.
        serial_number: of the vehicle, ``None`` where the log names none.
        provenance: which steps, parameters and inputs made the log; must be JSON.
        plan: what the autopilot decided, likewise by name.
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
        """Read a drive log of any kind but for its radar data; the file is closed again.

        Raises:
            InputError: the file is missing, damaged, of another format or of a newer major version, or something
                but the radar data is not as ``data_schema/drive.toml`` says.
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
        InputError: the log is not as ``data_schema/drive.toml`` says, or the output exists (without ``force``) or
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
