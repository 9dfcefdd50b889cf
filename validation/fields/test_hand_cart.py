"""The run of a hand cart, as its user starts it."""

import json
from pathlib import Path

import numpy as np
import pytest

from canon.commands import run, succeed
from cli.test_run_by_hand import driven
from lgprjax.formats import read_run, read_worked
from lgprjax.frames import LocalFrame
from lgprjax.run_records import ToolBits
from lgprjax.runtime.cart import smooth_cart_run
from lgprjax.worked.record import read_cover_run
from refusals import refused


@pytest.fixture(scope="module")
def cart(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return driven("cart", tmp_path_factory.mktemp("cart"), 40)


def test_a_hand_cart_is_recorded_live_and_smoothed_afterwards(cart: Path, tmp_path: Path) -> None:
    live = read_cover_run(cart)
    smoothed = smooth_cart_run(live)
    clock = read_run(cart).clock
    assert clock is not None
    assert live.without_plan is not None
    anchor = LocalFrame(*json.loads((cart / "devices.json").read_text(encoding="utf-8"))["anchor"])
    known = []
    with np.load(cart / "truth.npz") as truth:
        latitude, longitude, height = anchor.to_geodetic(truth["x_m"], truth["y_m"], np.zeros_like(truth["x_m"]))
        east, north, _ = live.without_plan.frame.to_local(latitude, longitude, height)
        way = {"x_m": east, "y_m": north, "yaw_rad": np.unwrap(truth["yaw_rad"])}
        for each in (live, smoothed):
            counts = (each.rows["tool"] & ToolBits.COUNTS) != 0
            at_ns = each.utc_ns[counts] - (clock[0] - clock[1])
            x, y, yaw = (
                each.rows[name][counts] - np.interp(at_ns, truth["mono_ns"], true) for name, true in way.items()
            )
            known.append(counts.sum() / 10.0)
            # Receivers of 2 cm; a cart of one world may have its slow error twice as large.
            assert np.sqrt(np.mean(x**2 + y**2)) < 0.05
            assert np.degrees(np.sqrt(np.mean(np.angle(np.exp(1j * yaw)) ** 2))) < 1.5
    # Afterwards the first metres are known as well, and the last seconds.
    assert known[0] > 10.0
    assert known[1] > known[0] + 6.0
    succeed("cover", "record", cart, "-o", tmp_path / "r.worked.h5", "--smooth")
    assert read_worked(tmp_path / "r.worked.h5").provenance["runs"][0]["tool"] == "not measured"


def test_a_changed_vehicle_file_is_refused(cart: Path, tmp_path: Path) -> None:
    live = read_cover_run(cart)
    assert live.without_plan is not None
    other = live.without_plan._replace(vehicle={"name": "x", "sha256": "ab" * 32})
    with refused("file", "abab"):
        smooth_cart_run(live._replace(without_plan=other))
    assert run("cover", "record", cart, "-o", tmp_path / "r.worked.h5", "--cart", "v.vehicle.toml").status == 2
