"""Vehicles: opened from vehicle files, and calibrated on their logs."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.api.inputs import PathLike, path_of, paths_of, told_as_arguments
from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats import VehicleFile, load_schema, read_vehicle, write_vehicle
from lgprjax.vehicle import Chassis, LookAhead, Servo

if TYPE_CHECKING:
    import pandas as pd

    from lgprjax.formats import Study
    from lgprjax.formats.settings_files import Kind
    from lgprjax.tuning.studies.steering import FinishedStudy


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A vehicle; a pytree of the parameters of a rollout, for jit and vmap.

    Attributes:
        file: all values of the vehicle file.
        path: path of the file; None for an unsaved vehicle.
        chassis: geometry and limits; None for a skid-steer vehicle, or if the file lacks a value.
        servo: lag, delay, rate, dead band and backlash of the steering; None in the same cases.
        look_ahead: look-ahead distance over speed; None if the file has none.
        delay_s: maximum delay in rollouts, s.
    """

    file: VehicleFile
    path: Path | None
    chassis: Chassis | None
    servo: Servo | None
    look_ahead: LookAhead | None
    delay_s: float

    @property
    def name(self) -> str:
        """Name of the vehicle."""
        return self.file.name

    def __repr__(self) -> str:
        kind = self.file.steering_kind.replace("_", "-")
        number = f", serial number {self.file.serial_number}" if self.file.serial_number else ""
        parts = [f"{len(self.file.found)} numbers calibrated"]
        if self.file.chassis.wheelbase_m is not None:
            parts.insert(0, f"wheelbase {self.file.chassis.wheelbase_m:g} m")
        if self.file.tool.width_m is not None:
            parts.insert(0, f"tool {self.file.tool.width_m:g} m wide")
        return f"Vehicle {self.name!r}: {kind}{number}, {', '.join(parts)}"

    def save(self, path: PathLike, *, force: bool = False) -> "Vehicle":
        """Write ``X.vehicle.toml``, each key with its description; returns the vehicle of that file.

        Raises:
            InputError: the name has another suffix, or the file exists (without ``force``) or cannot be written.
        """
        target = path_of(path, "vehicle")
        if not target.name.endswith(".vehicle.toml"):
            raise InputError(target, "file name", "a name that ends in .vehicle.toml", repr(target.name))
        with told_as_arguments():
            write_vehicle(target, self.file, force=force)
        return vehicle_of(self.file, target.absolute())


class _Label:
    """The static part of a vehicle: equal files compare equal, so that nothing is recompiled."""

    def __init__(self, file: VehicleFile, path: Path | None, delay_s: float) -> None:
        self.file, self.path, self.delay_s = file, path, delay_s

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Label) and self.file == other.file and self.delay_s == other.delay_s

    def __hash__(self) -> int:
        return hash((self.file.name, self.delay_s))


jax.tree_util.register_pytree_node(
    Vehicle,
    lambda each: ((each.chassis, each.servo, each.look_ahead), _Label(each.file, each.path, each.delay_s)),
    lambda label, leaves: Vehicle(label.file, label.path, *leaves, label.delay_s),
)


def open_vehicle(path: PathLike) -> Vehicle:
    """Open a vehicle file.

    Args:
        path: vehicle file, ``X.vehicle.toml``.

    Raises:
        InputError: the file is missing, or does not match data_schema/vehicle.toml.

    Example:
        vehicle = lx.open_vehicle("made_up.vehicle.toml")
        print(vehicle)                     # Vehicle 'made-up vehicle on board': counter-steer, ...
        print(vehicle.file.steering.lag_s)
    """
    file = path_of(path, "vehicle")
    return vehicle_of(read_vehicle(file), file.absolute())


def vehicle_of(file: VehicleFile, path: Path | None) -> Vehicle:
    """A vehicle with the contents of its file; rollouts check for missing numbers by ``moving_parts``."""
    chassis = servo = look_ahead = None
    with suppress(InputError):
        chassis, servo = moving_parts(file, path)
    told = [getattr(file.pursuit, name) for name in LookAhead._fields]
    if all(value is not None for value in told):
        look_ahead = LookAhead(*(jnp.float32(value) for value in told))
    return Vehicle(file, path, chassis, servo, look_ahead, file.steering.delay_s or 0.0)


def moving_parts(file: VehicleFile, path: Path | None) -> tuple[Chassis, Servo]:
    """Chassis and steering servo of a vehicle file.

    Raises:
        InputError: a skid-steer vehicle, or a required number is not in the file.
    """
    from lgprjax.recordings import chassis_of, servo_of

    where = "vehicle file" if path is None else path
    return chassis_of(file, where), servo_of(file, where)


@dataclass(frozen=True, eq=False)
class Tuned:
    """Result of a study.

    Attributes:
        name: name of the study.
        kind: kind of the study, such as ``rear_ratio`` or ``servo``.
        vehicle: vehicle with the fitted values; ``vehicle.save(path)`` writes its file.
        notes: remarks.
        finished: full result of the study; ``finished.outcome.detail`` has the data of its pictures.
    """

    name: str
    kind: str
    vehicle: Vehicle
    notes: tuple[str, ...]
    finished: "FinishedStudy"

    def __repr__(self) -> str:
        rows = [f"{row.number} = {row.value:.5g} {row.unit}".rstrip() for row in self.table.itertuples()]
        more = f" and {len(rows) - 4} more" if len(rows) > 4 else ""
        return f"Tuned {self.name!r} ({self.kind}): {', '.join(rows[:4])}{more}"

    @property
    def figures(self) -> "pd.DataFrame":
        """DataFrame with a row per quality figure: value, 95 % interval if available, unit."""
        import pandas as pd

        return pd.DataFrame(self.finished.outcome.figures, columns=["figure", "value", "unit", "low", "high"])

    def draw(self, folder: PathLike, *, force: bool = False) -> dict[str, Path]:
        """Draw the pictures of the study, as ``lgprjax tune`` does. Returns the PNG files by name.

        Args:
            folder: folder for the pictures; created if missing.
            force: replace existing files.

        Raises:
            InputError: a picture exists, or cannot be written.
        """
        from lgprjax.report.study_pictures import study_pictures

        target = path_of(folder, "folder")
        drawn = {name: target / f"{self.name}.{name}.png" for name in study_pictures(self.kind)}
        with told_as_arguments():
            target.mkdir(parents=True, exist_ok=True)
            for name, draw in study_pictures(self.kind).items():
                draw(self.finished.outcome.detail, drawn[name], force)
        return drawn

    def _repr_png_(self) -> bytes | None:
        """The study's first picture, for notebooks; None for a kind without one."""
        from lgprjax.report.study_pictures import study_pictures

        draw = list(study_pictures(self.kind).values())
        if not draw:
            return None
        with TemporaryDirectory() as folder:
            draw[0](self.finished.outcome.detail, Path(folder) / "study.png", False)
            return (Path(folder) / "study.png").read_bytes()

    @cached_property
    def table(self) -> "pd.DataFrame":
        """DataFrame with a row per parameter: value and 95 % interval (none for a set value)."""
        import pandas as pd

        units = {entry.path: entry.unit for entry in load_schema("vehicle").keys}
        outcome, rows = self.finished.outcome, []
        for path, found in outcome.found.items():
            for number, one in enumerate(found if isinstance(found, list) else [found]):
                place = f"{path}[{number}]" if isinstance(found, list) else path
                rows.append((place, one.value, one.low, one.high, units[path]))
        rows += [(path, value, np.nan, np.nan, units[path]) for path, value in outcome.fixed.items()]
        return pd.DataFrame(rows, columns=["number", "value", "low", "high", "unit"])


def tune(
    study: "PathLike | Study",
    *,
    vehicle: "Vehicle | PathLike | None" = None,
    logs: PathLike | Iterable[PathLike] = (),
    held_out: PathLike | Iterable[PathLike] = (),
    **options: object,
) -> Tuned:
    """Run a study on drive logs of a vehicle: a calibration with 95 % intervals, or the look-ahead.

    The function writes no file. tuning/ has example studies; docs/vehicle.md lists their inputs.

    Args:
        study: study file, with paths relative to its folder; with ``vehicle``: kind of study, such as ``"tracking"``,
            ``"loop"`` or ``"look_ahead"``.
        vehicle: vehicle opened from a file, or the path of the file.
        logs, held_out: with ``vehicle``: drives, drive logs, or folders of recorded runs; one or several.
        options: with ``vehicle``: options of the study.

    Returns:
        Tuned: ``vehicle`` with the fitted values, ``table`` with their intervals.

    Raises:
        InputError: logs or options without ``vehicle``; a file cannot be read, belongs to another vehicle, or lacks
            data for the fit.

    Example:
        tuned = lx.tune("tuning/k_ratio.toml")
        print(tuned)                       # Tuned 'k_ratio' (rear_ratio): steering.rear_ratio = 0.63
        tuned.vehicle.save("tuned.vehicle.toml", force=True)
    """
    from lgprjax.formats import Study, read_study
    from lgprjax.tuning.studies.steering import run_study

    if vehicle is not None:
        file = vehicle.path if isinstance(vehicle, Vehicle) else path_of(vehicle, "vehicle")
        if file is None:
            raise InputError("call", "vehicle", "a vehicle saved to a file (save it first)", repr(vehicle))
        asked = Study(
            file=Path("call"),
            name=str(study),
            kind=_kind(study),
            vehicle=file,
            serial_number=None,
            logs=_log_paths(logs),
            held_out=_log_paths(held_out),
            options=dict(options),
        )
    else:
        given = [name for name, paths in (("logs", logs), ("held_out", held_out)) if _log_paths(paths)] + list(options)
        if given:
            raise ArgumentError(", ".join(given), "the argument vehicle (only a study file names its own)", "none")
        asked = study if isinstance(study, Study) else read_study(path_of(study, "study"))
    finished = run_study(asked)
    return Tuned(asked.name, asked.kind, vehicle_of(finished.vehicle, None), finished.outcome.notes, finished)


def _kind(given: "PathLike | Study") -> "Kind":
    from lgprjax.formats.settings_files import KINDS

    for kind in KINDS:
        if given == kind:
            return kind
    raise InputError("call", "study", "with a vehicle, one of " + ", ".join(KINDS), repr(given)[:60])


def _log_paths(given: PathLike | Iterable[PathLike]) -> tuple[Path, ...]:
    # Some studies need no log.
    return () if isinstance(given, list | tuple) and not given else tuple(paths_of(given, "log"))
