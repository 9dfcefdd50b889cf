"""Numbers of several vehicle files side by side: what differs by more than chance, and how one vehicle drifts.

Vehicles of one kind differ in their linkages: LL overlays their encoder and palm-tree curves (figs. 17 and 19).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from scipy.special import chdtrc

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats import VehicleFile, flat_keys

CHANCE = 0.05
"""Probability that any number of alike vehicles is reported as different."""
_SIGMAS = 3.92
"""Width of a 95 % interval."""


class FleetNumber(NamedTuple):
    """A number that at least one of the files has.

    Attributes:
        path: path of the number in the vehicle file, such as ``steering.lag_s``.
        value: value for each vehicle; NaN where a file lacks the number.
        low, high, sigma: ends of its 95 % interval and standard error; NaN where no study found the number.
        spread: largest value minus smallest.
        p: probability of so much spread, or more, among alike vehicles; NaN with fewer than two standard errors.
        differs: whether the vehicles differ by more than chance, all numbers of the fleet considered.
    """

    path: str
    value: Float[np.ndarray, " vehicle"]
    low: Float[np.ndarray, " vehicle"]
    high: Float[np.ndarray, " vehicle"]
    sigma: Float[np.ndarray, " vehicle"]
    spread: float
    p: float
    differs: bool


class Drift(NamedTuple):
    """Change of a number of one vehicle, from its first file to its last.

    Attributes:
        serial_number: serial number of the vehicle.
        path: path of the number in the vehicle file.
        first, last: names of the first and the last file.
        change: last value minus first.
        sigma: standard error of the change.
        p: probability of so large a change, or a larger one, without drift.
        differs: whether the change exceeds chance, all numbers of all vehicles considered.
    """

    serial_number: str
    path: str
    first: str
    last: str
    change: float
    sigma: float
    p: float
    differs: bool


class Fleet(NamedTuple):
    """Vehicle files side by side.

    Attributes:
        names: names of the files, without ``.vehicle.toml``; with their folders where names are alike.
        vehicles: contents of the files, in the same order.
        numbers: numbers that any of the files has, in the order of the files.
        drifts: changes of numbers of vehicles with several files.
    """

    names: tuple[str, ...]
    vehicles: tuple[VehicleFile, ...]
    numbers: tuple[FleetNumber, ...]
    drifts: tuple[Drift, ...]

    @property
    def estimated(self) -> tuple[FleetNumber, ...]:
        """Numbers that a study found for at least one vehicle."""
        return tuple(each for each in self.numbers if np.isfinite(each.sigma).any())


def compare_fleet(files: Mapping[Path, VehicleFile]) -> Fleet:
    """Compare vehicle files.

    A number differs if the weighted squared deviations from the common mean exceed those of alike vehicles
    (chi-square test; Holm's correction over all numbers tested). Numbers that no study found are listed, not tested.
    Files with one serial number are one vehicle, in the order given: its drift is tested, and only its last file is
    compared with the others.

    Args:
        files: contents of at least two vehicle files of one steering kind, by path.

    Raises:
        InputError: fewer than two files, or different steering kinds.
    """
    paths, vehicles = list(files), tuple(files.values())
    if len(paths) < 2:
        raise ArgumentError("vehicles", "at least two vehicle files", str(len(paths)))
    for place, path in enumerate(paths):
        if vehicles[place].steering_kind != vehicles[0].steering_kind:
            raise InputError(path, "steering_kind", vehicles[0].steering_kind, vehicles[place].steering_kind)
    names = _names(paths)
    newest = _newest(vehicles)
    numbers = [_number(path, vehicles, newest) for path in _paths_of(vehicles)]
    differs = _holm([each.p for each in numbers])
    drifts = _drifts(names, vehicles, numbers)
    drifted = _holm([each.p for each in drifts])
    return Fleet(
        names,
        vehicles,
        tuple(each._replace(differs=yes) for each, yes in zip(numbers, differs, strict=True)),
        tuple(each._replace(differs=yes) for each, yes in zip(drifts, drifted, strict=True)),
    )


def _names(paths: Sequence[Path]) -> tuple[str, ...]:
    """File names with the fewest parent folders that make them unique."""
    whole = [path.resolve().parts for path in paths]
    for parts in range(1, max(map(len, whole)) + 1):
        names = tuple("/".join(each[-parts:]).removesuffix(".vehicle.toml") for each in whole)
        if len(set(names)) == len(names):
            return names
    raise AssertionError("paths of a mapping differ")


def table_of_fleet(fleet: Fleet) -> pd.DataFrame:
    """A row for each number and vehicle: value, interval, standard error, and origin of the number."""
    rows = [
        (
            each.path,
            name,
            each.value[place],
            each.low[place],
            each.high[place],
            each.sigma[place],
            _state(vehicle, each.path),
        )
        for each in fleet.numbers
        for place, (name, vehicle) in enumerate(zip(fleet.names, fleet.vehicles, strict=True))
        if np.isfinite(each.value[place])
    ]
    return pd.DataFrame(rows, columns=["number", "vehicle", "value", "low", "high", "sigma", "state"])


def _state(vehicle: VehicleFile, path: str) -> str:
    if path in vehicle.assumed:
        return "assumed"
    return vehicle.found[path].study if path in vehicle.found else "stated"


def _paths_of(vehicles: Sequence[VehicleFile]) -> list[str]:
    """Paths of all plain numbers, in the order in which they appear."""
    paths = dict[str, None]()
    for vehicle in vehicles:
        table = vehicle.model_dump(exclude_none=True, exclude={"found", "assumed"})
        paths |= {
            path: None
            for path, value in flat_keys(table).items()
            if isinstance(value, int | float) and not isinstance(value, bool)
        }
    return list(paths)


def _number(path: str, vehicles: Sequence[VehicleFile], newest: Bool[np.ndarray, " vehicle"]) -> FleetNumber:
    value, low, high, sigma = np.full((4, len(vehicles)), np.nan)
    for place, vehicle in enumerate(vehicles):
        held = flat_keys(vehicle.model_dump(exclude_none=True, exclude={"found", "assumed"}))
        found = vehicle.found.get(path)
        value[place] = held.get(path, np.nan)
        if found is not None and isinstance(found.low, float) and isinstance(found.high, float):
            low[place], high[place] = found.low, found.high
            told = found.sigma if isinstance(found.sigma, float) else (found.high - found.low) / _SIGMAS
            sigma[place] = told if told > 0.0 else np.nan
    known = newest & np.isfinite(sigma)
    weight = sigma[known] ** -2.0
    p = np.nan
    if len(weight) > 1:
        mean = np.average(value[known], weights=weight)
        p = float(chdtrc(len(weight) - 1, np.sum(weight * (value[known] - mean) ** 2)))
    spread = float(np.nanmax(value) - np.nanmin(value))
    return FleetNumber(path=path, value=value, low=low, high=high, sigma=sigma, spread=spread, p=p, differs=False)


def _newest(vehicles: Sequence[VehicleFile]) -> Bool[np.ndarray, " vehicle"]:
    """Mask of the last file of each vehicle."""
    later = [vehicle.serial_number for vehicle in vehicles]
    return np.array([number is None or number not in later[place + 1 :] for place, number in enumerate(later)])


def _drifts(names: Sequence[str], vehicles: Sequence[VehicleFile], numbers: Sequence[FleetNumber]) -> list[Drift]:
    serial = [vehicle.serial_number for vehicle in vehicles]
    drifts = []
    for each in dict.fromkeys(number for number in serial if number is not None and serial.count(number) > 1):
        own = [place for place, number in enumerate(serial) if number == each]
        for number in numbers:
            known = [place for place in own if np.isfinite(number.sigma[place])]
            if len(known) > 1:
                first, last = known[0], known[-1]
                change = float(number.value[last] - number.value[first])
                sigma = float(np.hypot(number.sigma[first], number.sigma[last]))
                p = float(chdtrc(1, (change / sigma) ** 2))
                drifts.append(
                    Drift(
                        serial_number=each,
                        path=number.path,
                        first=names[first],
                        last=names[last],
                        change=change,
                        sigma=sigma,
                        p=p,
                        differs=False,
                    )
                )
    return drifts


def _holm(p: Sequence[float]) -> list[bool]:
    """Tests that reject, with probability ``CHANCE`` of any wrong rejection (Holm, 1979); NaN never rejects."""
    tested = [place for place in np.argsort(p) if np.isfinite(p[place])]
    rejected = [False] * len(p)
    for rank, place in enumerate(tested):
        if p[place] > CHANCE / (len(tested) - rank):
            break
        rejected[place] = True
    return rejected
