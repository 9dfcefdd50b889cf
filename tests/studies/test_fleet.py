"""Vehicle files side by side: false differences are as rare as promised, true ones and drifts are found."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.stats import chi2

from canon.commands import run, succeed
from lgprjax.formats import VehicleFile, write_vehicle
from lgprjax.tuning.studies.fleet import CHANCE, Fleet, compare_fleet
from refusals import refused

TRUE = {"rear_ratio": 0.6, "lag_s": 0.15, "delay_s": 0.06, "characteristic_speed_mps": 15.0}
SIGMA = {"rear_ratio": 0.004, "lag_s": 0.006, "delay_s": 0.003, "characteristic_speed_mps": 0.4}


def drawn(seed: int, serial: str | None = None, **off: float) -> VehicleFile:
    """A vehicle whose numbers are ``off`` the common ones, and were found with normal errors."""
    rng = np.random.default_rng(seed)
    found, steering = {}, {}
    for name, true in TRUE.items():
        value = true + off.get(name, 0.0) + SIGMA[name] * rng.standard_normal()
        low, high = value - 1.96 * SIGMA[name], value + 1.96 * SIGMA[name]
        steering[name] = value
        found[f"steering.{name}"] = {"low": low, "high": high, "sigma": SIGMA[name], "study": "s", "log": "a.drive.h5"}
    table: dict[str, Any] = {"name": "v", "steering_kind": "counter_steer", "steering": steering, "found": found}
    table |= {"chassis": {"wheelbase_m": 3.8}, "serial_number": serial}
    return VehicleFile.model_validate(table)


def fleet(*vehicles: VehicleFile) -> Fleet:
    return compare_fleet({Path(f"v{place}.vehicle.toml"): each for place, each in enumerate(vehicles)})


def test_alike_vehicles_seldom_differ() -> None:
    said = [
        any(each.differs for each in fleet(*(drawn(4 * draw + n) for n in range(4))).numbers) for draw in range(400)
    ]
    # Four standard errors of a share of 400 draws.
    assert np.mean(said) == pytest.approx(CHANCE, abs=4.0 * np.sqrt(CHANCE * (1.0 - CHANCE) / 400))


def test_the_one_that_differs_is_found_and_its_p_is_that_of_the_chi_square() -> None:
    found = fleet(drawn(1), drawn(2), drawn(3, lag_s=0.06))
    assert [each.path for each in found.numbers if each.differs] == ["steering.lag_s"]
    lag = next(each for each in found.numbers if each.path == "steering.lag_s")
    # All are as sure, so the weighted mean is the plain one.
    squares = np.sum((lag.value - lag.value.mean()) ** 2) / SIGMA["lag_s"] ** 2
    assert lag.p == pytest.approx(chi2.sf(squares, 2), rel=1e-6)
    assert lag.spread == pytest.approx(np.ptp(lag.value))
    wheelbase = next(each for each in found.numbers if each.path == "chassis.wheelbase_m")
    assert np.isnan(wheelbase.p)


def test_files_of_one_vehicle_are_its_months() -> None:
    found = fleet(drawn(1, "A"), drawn(2, "A", rear_ratio=0.01), drawn(3, "A", rear_ratio=0.04), drawn(4, "B"))
    (drift,) = (each for each in found.drifts if each.differs)
    assert (drift.serial_number, drift.path, drift.first, drift.last) == ("A", "steering.rear_ratio", "v0", "v2")
    assert drift.change == pytest.approx(0.04, abs=4.0 * drift.sigma)
    # Its last file alone is held against the other vehicle: one number of two values.
    ratio = next(each for each in found.numbers if each.path == "steering.rear_ratio")
    apart = (ratio.value[2] - ratio.value[3]) / np.hypot(*ratio.sigma[2:])
    assert ratio.p == pytest.approx(chi2.sf(apart**2, 1), rel=1e-6)


def test_what_cannot_be_compared() -> None:
    with refused("vehicles", found="1"):
        fleet(drawn(1))
    skid = VehicleFile.model_validate({"name": "s", "steering_kind": "skid_steer", "skid_steer": {"track_m": 0.7}})
    with refused("steering_kind", "counter_steer", found="skid_steer", file="v1.vehicle.toml"):
        fleet(drawn(1), skid)


def test_the_command_writes_a_table_and_two_pictures(tmp_path: Path) -> None:
    paths = [tmp_path / month / "kit.vehicle.toml" for month in ("march", "may")]
    for seed, path in enumerate(paths):
        path.parent.mkdir()
        write_vehicle(path, drawn(seed, "A", rear_ratio=0.05 * seed))
    out, figures = tmp_path / "out", tmp_path / "figures.json"
    said = succeed("tune", "compare", *paths, "-o", out, "--json", figures)
    assert "drift: A steering.rear_ratio" in said
    assert sorted(path.name for path in out.iterdir()) == ["fleet.csv", "fleet.curves.png", "fleet.numbers.png"]
    table = pd.read_csv(out / "fleet.csv")
    assert set(table["vehicle"]) == {"march/kit", "may/kit"}
    assert set(table.loc[table["number"] == "chassis.wheelbase_m", "state"]) == {"stated"}
    (drift,) = (each for each in json.loads(figures.read_text())["drifts"] if each["differs"])
    assert drift["path"] == "steering.rear_ratio"
    before = (out / "fleet.csv").read_bytes()
    run("tune", "compare", *paths, "-o", out).refusal.check("output", "--force", file=out / "fleet.csv")
    run("tune", "compare", paths[0], tmp_path / "none.vehicle.toml", "-o", out).refusal.check("file")
    for given in (paths[:1], [paths[0], paths[0]], [paths[0], paths[0].parent / "." / ".." / "march" / paths[0].name]):
        done = run("tune", "compare", *given, "-o", out)
        assert (done.status, done.about) == (2, "VEHICLE.toml")
    assert (out / "fleet.csv").read_bytes() == before
