"""A hand cart's log as a record: sentences in, ground claimed where the cart was, and nothing said of its tool."""

import itertools
import json
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from pathlib import Path

import numpy as np
import pytest

from lgprjax.frames import LocalFrame
from lgprjax.runtime.cart import read_cart_fixes, read_cart_run
from lgprjax.worked.layers import cover_figures, grid_of, inside_of
from lgprjax.worked.plans import PlanFile, PlanOptions, make_cover_plan, open_cover_plan, save_cover_plan
from lgprjax.worked.record import record_cover
from navigation.cart_drives import ANTENNA_X_M, ANTENNA_Y_M
from refusals import refused
from true_cells import true_cells

FRAME = LocalFrame(40.0, -100.0, 0.0)
FIELD_M = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 6.0], [0.0, 6.0]])
START = datetime(2026, 3, 1, 23, 58, 0, tzinfo=UTC)
VEHICLE = f"""
schema = "lgprjax.vehicle"
schema_version = "1.4"
name = "cart"
steering_kind = "skid_steer"
[skid_steer]
track_m = 0.7
smallest_radius_m = 1.0
largest_wheel_mps = 0.5
wheel_rate_mps2 = 1.0
[tool]
width_m = 1.0
length_m = 0.3
ahead_m = 0.6
left_m = 0.0
[navigation]
gnss_x_m = {ANTENNA_X_M}
gnss_y_m = {ANTENNA_Y_M}
"""


def sentence(body: str) -> str:
    return f"${body}*{reduce(xor, body.encode(), 0):02X}\r\n"


def degrees(value: float, width: int, letters: str) -> str:
    whole = int(abs(value))
    return f"{whole:0{width}d}{60.0 * (abs(value) - whole):010.7f},{letters[int(value < 0.0)]}"


def log_of(
    time_s: np.ndarray,
    antenna_m: np.ndarray,
    *,
    dated: bool = True,
    stated: bool = True,
    order: tuple[str, ...] = ("GGA", "GST", "RMC"),
    quality: int = 4,
    sigma_m: float = 0.02,
) -> bytes:
    """GGA, GST and RMC once a second, across midnight."""
    latitude, longitude, height = FRAME.to_geodetic(antenna_m[:, 0], antenna_m[:, 1], np.zeros(len(time_s)))
    parts = []
    for at, one, other, up in zip(time_s, latitude, longitude, height, strict=True):
        utc = START + timedelta(seconds=float(at))
        clock = f"{utc:%H%M%S}.{utc.microsecond // 10000:02d}"
        place = f"{degrees(one, 2, 'NS')},{degrees(other, 3, 'EW')}"
        said = {"GGA": sentence(f"GNGGA,{clock},{place},{quality},20,0.6,{up:.3f},M,0.0,M,1.0,0000")}
        if stated:
            said["GST"] = sentence(f"GNGST,{clock},0.02,0.02,0.02,0,{sigma_m:.3f},{sigma_m:.3f},0.03")
        if dated:
            said["RMC"] = sentence(f"GNRMC,{clock},A,{place},0.8,0.0,{utc:%d%m%y},,,R")
        parts += [said[each] for each in order if each in said]
    return "".join(parts).encode()


def pulled() -> tuple[np.ndarray, np.ndarray]:
    """Three lines of 18 m at 0.3 m/s, 3 m apart, half turns between them: pose every 0.1 s, and times."""
    step_m, pose, x, y, yaw = 0.03, [], -3.0, 0.6, 0.0
    for line in range(3):
        ways = [(18.0, 0.0), (1.5 * np.pi, 1.0 / 1.5 if line % 2 == 0 else -1.0 / 1.5)]
        for way_m, bend in ways[: 2 if line < 2 else 1]:
            for _ in range(round(way_m / step_m)):
                yaw += bend * step_m
                x, y = x + step_m * np.cos(yaw), y + step_m * np.sin(yaw)
                pose.append((x, y, yaw))
    return np.array(pose), 0.1 * np.arange(len(pose))


def antenna_of(pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    x, y, yaw = pose.T
    at = np.stack(
        [ANTENNA_X_M * np.cos(yaw) - ANTENNA_Y_M * np.sin(yaw), ANTENNA_X_M * np.sin(yaw) + ANTENNA_Y_M * np.cos(yaw)]
    )
    there: np.ndarray = np.stack([x, y], axis=1) + at.T + 0.015 * rng.standard_normal((len(pose), 2))
    return there


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A plan, the cart's vehicle file, and its log."""
    made = tmp_path_factory.mktemp("cart")
    (made / "cart.vehicle.toml").write_text(VEHICLE)
    latitude, longitude, _ = FRAME.to_geodetic(FIELD_M[:, 0], FIELD_M[:, 1], np.zeros(4))
    ring = [[float(x), float(y)] for x, y in zip(longitude, latitude, strict=True)]
    (made / "f.geojson").write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]]]}))
    plan = make_cover_plan(made / "f.geojson", made / "cart.vehicle.toml", PlanOptions(0.0, "boustrophedon"))
    assert plan is not None
    save_cover_plan(made / "f.cover.geojson", plan)
    pose, time_s = pulled()
    (made / "cart.nmea").write_bytes(log_of(time_s[::10], antenna_of(pose[::10], np.random.default_rng(3))))
    return made


def plan_of(folder: Path) -> PlanFile:
    return open_cover_plan(folder / "f.cover.geojson")


def test_a_log_is_read_with_its_dates_across_midnight(folder: Path) -> None:
    pose, time_s = pulled()
    fixes = read_cart_fixes(folder / "cart.nmea")
    assert len(fixes.utc_ns) == len(time_s[::10])
    np.testing.assert_allclose(fixes.utc_ns / 1e9 - START.timestamp(), time_s[::10], atol=0.006)
    east, north, _ = FRAME.to_local(fixes.latitude_deg, fixes.longitude_deg, fixes.height_m)
    assert np.hypot(east - pose[::10, 0], north - pose[::10, 1]).max() < 0.4
    assert set(fixes.sigma_m) == {0.02}


@pytest.mark.parametrize("quality", [4, 5], ids=["fixed", "float"])
def test_a_stated_accuracy_holds_in_whatever_order_the_sentences_come(tmp_path: Path, quality: int) -> None:
    pose, time_s = pulled()
    few = slice(0, 300, 10)
    antenna = antenna_of(pose[few], np.random.default_rng(5))
    for order in itertools.permutations(("GGA", "GST", "RMC")):
        (tmp_path / "cart.nmea").write_bytes(log_of(time_s[few], antenna, order=order, quality=quality, sigma_m=0.08))
        fixes = read_cart_fixes(tmp_path / "cart.nmea")
        assert len(fixes.utc_ns) == len(antenna)
        np.testing.assert_allclose(fixes.sigma_m, 0.08)


def test_what_a_log_lacks_is_told(tmp_path: Path) -> None:
    pose, time_s = pulled()
    few = slice(0, 300, 10)
    antenna = antenna_of(pose[few], np.random.default_rng(4))
    (tmp_path / "undated.nmea").write_bytes(log_of(time_s[few], antenna, dated=False))
    with refused("date", "RMC", "ZDA", "NAV-PVT"):
        read_cart_fixes(tmp_path / "undated.nmea")
    (tmp_path / "empty.nmea").write_bytes(b"nothing at all")
    with refused("positions", "GGA", "NAV-PVT"):
        read_cart_fixes(tmp_path / "empty.nmea")
    with refused("file", file="none.nmea"):
        read_cart_fixes(tmp_path / "none.nmea")
    # Fixed, and no accuracy stated: 2 cm.
    (tmp_path / "unstated.nmea").write_bytes(log_of(time_s[few], antenna, stated=False))
    assert set(read_cart_fixes(tmp_path / "unstated.nmea").sigma_m) == {0.02}


def test_a_cart_is_recorded_where_it_was(folder: Path) -> None:
    plan = plan_of(folder)
    run = read_cart_run(folder / "cart.nmea", folder / "cart.vehicle.toml", plan)
    record = record_cover([plan], [run], cell_m=0.1)
    pose, _ = pulled()
    frame = plan.plan.frame
    latitude, longitude, height = FRAME.to_geodetic(pose[:, 0], pose[:, 1], np.zeros(len(pose)))
    east, north, _ = frame.to_local(latitude, longitude, height)
    truth = np.column_stack([east, north, pose[:, 2]])
    over = true_cells(grid_of(record), plan.plan.tool, truth, np.ones(len(truth), bool))
    inside = inside_of(record)
    processed = (record.cells.state[0] == 2) & inside
    assert np.mean(over[processed]) > 0.999
    # Lines of a metre, less a margin of 5 cm shared and what the cart's own error is.
    assert 0.6 < processed.sum() / (over & inside).sum() < 0.95
    figures = cover_figures(record)
    assert figures.depth_mean_m is None
    assert figures.fixed > 0.95
    assert record.provenance["runs"][0]["tool"] == "not measured"


def test_a_cart_with_another_tool_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "wide.vehicle.toml").write_text(VEHICLE.replace("width_m = 1.0", "width_m = 2.0"))
    with refused("tool", "f.cover.geojson"):
        read_cart_run(folder / "cart.nmea", tmp_path / "wide.vehicle.toml", plan_of(folder))
