"""Drives, strips and surfaces with known answers."""

import re
from typing import Any

import numpy as np

from lgprjax.report import CorrelationSurface, DriveResult, MatchExample


def straight_drive(scans: int = 400, *, seed: int = 3, **changes: Any) -> DriveResult:
    """60 m along a bearing of 50°, errors of 3 cm, a stretch of declined fixes; ``changes`` replace fields."""
    rng = np.random.default_rng(seed)
    distance = np.linspace(0.0, 60.0, scans)
    yaw = np.full(scans, np.radians(40.0)) + 0.01 * np.sin(distance / 9.0)
    side = 0.25 * np.sin(distance / 11.0)
    cos, sin = np.cos(np.radians(40.0)), np.sin(np.radians(40.0))
    truth_east, truth_north = 12.0 + distance * cos - side * sin, -7.0 + distance * sin + side * cos
    sigma_along, sigma_cross = 0.02 + 0.01 * rng.random(scans), 0.03 + 0.01 * rng.random(scans)
    off_along, off_cross = sigma_along * rng.standard_normal(scans), sigma_cross * rng.standard_normal(scans)
    off_cross += 0.03 * np.sin(distance / 6.0)
    code = np.full(scans, "ok", dtype="<U16")
    code[(distance > 21.0) & (distance < 25.0)] = "low_correlation"
    code[(distance > 40.0) & (distance < 41.0)] = "ambiguous"
    code[distance > 58.5] = "off_map"
    correlation = np.clip(0.86 + 0.04 * rng.standard_normal(scans), 0.0, 1.0)
    correlation[code == "low_correlation"] -= 0.5
    margin = np.clip(0.2 + 0.04 * rng.standard_normal(scans), 0.0, 1.0)
    margin[code == "ambiguous"] = 0.02
    east = truth_east + np.cos(yaw) * off_along - np.sin(yaw) * off_cross
    north = truth_north + np.sin(yaw) * off_along + np.cos(yaw) * off_cross
    off_map = code == "off_map"
    p_false = np.where(off_map, 1.0, 10.0 ** -np.clip(40.0 * correlation - 27.0, 0.0, None))
    for field in (east, north, correlation, margin):
        field[off_map] = np.nan
    along = np.linspace(-20.0, 90.0, 200)
    fields: dict[str, Any] = {
        "name": "second drive, rain",
        "map_name": "north road",
        "origin": (42.459_312, -71.265_401),
        "milliseconds_per_scan": 0.61,
        "time_s": distance / 4.5,
        "distance_m": distance,
        "east_m": east,
        "north_m": north,
        "prior_east_m": truth_east + 0.4 * np.sin(distance / 20.0) - 0.3,
        "prior_north_m": truth_north + 0.5 * np.cos(distance / 15.0),
        "heading_rad": yaw + 0.01,
        "sigma_along_m": sigma_along,
        "sigma_cross_m": sigma_cross,
        "correlation": correlation,
        "margin": margin,
        "p_false": p_false,
        "code": code,
        "truth_east_m": truth_east,
        "truth_north_m": truth_north,
        "truth_yaw_rad": yaw,
        "correlation_at_truth": np.clip(0.85 + 0.03 * rng.standard_normal(scans), 0.0, 1.0),
        "baseline_tracks": tuple(
            np.stack([12.0 + along * cos - side * sin, -7.0 + along * sin + side * cos], axis=1) for side in (-0.6, 0.6)
        ),
    }
    return DriveResult(**(fields | changes))


def without_truth(scans: int = 400, **changes: Any) -> DriveResult:
    """The same drive as an archive has it."""
    none: dict[str, Any] = dict.fromkeys(("truth_east_m", "truth_north_m", "truth_yaw_rad", "correlation_at_truth"))
    return straight_drive(scans, **(none | changes))


def declined_drive(scans: int = 200, **changes: Any) -> DriveResult:
    """Another place's ground: nothing reaches the thresholds."""
    rng = np.random.default_rng(8)
    nothing = np.full(scans, np.nan)
    fields: dict[str, Any] = {
        "name": "other road",
        "impostor": True,
        "code": np.where(rng.random(scans) < 0.85, "low_correlation", "ambiguous"),
        "correlation": np.clip(0.22 + 0.08 * rng.standard_normal(scans), 0.0, 1.0),
        "margin": np.abs(0.02 * rng.standard_normal(scans)),
        "p_false": 10.0 ** -rng.uniform(0.0, 3.0, scans),
        "east_m": nothing,
        "north_m": nothing,
    }
    return without_truth(scans, **(fields | changes))


def match_example() -> MatchExample:
    """Layers and hyperbolae at 0.1 m/ns, 8 m long, 60 ns deep; the negative shows other ground."""
    distance, time = np.arange(160) * 0.05 + 20.0, np.arange(180) * 60.0 / 180
    live, beside = (_radargram(distance, time, seed) for seed in (1, 2))
    noise = np.random.default_rng(9).standard_normal((2, *live.shape)) * 0.12
    return MatchExample(
        baseline=live + noise[0],
        live=live + noise[1],
        beside=beside + noise[0],
        beside_m=1.0,
        distance_m=distance,
        time_ns=time,
        channel=5,
        correlation=0.874,
        margin=0.213,
        lag_m=-0.012,
        gain="spreading and absorption, t · exp(0.02 t/ns)",
        window_m=(24.0, 26.0),
    )


def _radargram(distance_m: np.ndarray, time_ns: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    image = np.zeros((len(distance_m), len(time_ns)))
    arrivals = [
        np.hypot(rng.uniform(8.0, 50.0), (distance_m - x) * 20.0)
        for x in rng.uniform(distance_m[0], distance_m[-1], 14)
    ]
    arrivals += [d + rng.uniform(1.0, 3.0) * np.sin(distance_m / rng.uniform(0.6, 2.0)) for d in (12.0, 27.0, 43.0)]
    for arrival in arrivals:
        phase = (time_ns[None, :] - arrival[:, None]) * 0.25 * np.pi
        image += rng.uniform(0.4, 1.0) * (1.0 - 2.0 * phase**2 / 3) * np.exp(-(phase**2) / 3)
    return image


def numbers(text: str) -> list[str]:
    """Numbers in a text, as they stand there."""
    return re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", text)


def correlation_surface() -> CorrelationSurface:
    """A summit near the truth, a ridge along the layers, a rival, and a corner off the map."""
    x, y = np.linspace(-2.0, 2.0, 81), np.linspace(-1.5, 1.5, 61)
    east, north = np.meshgrid(x, y, indexing="ij")
    correlation = 0.62 * np.exp(-(((east - 0.42) / 0.12) ** 2) - ((north + 0.2) / 0.18) ** 2)
    correlation += 0.5 * np.exp(-(((east + 0.9) / 0.15) ** 2) - ((north - 0.5) / 0.2) ** 2)
    correlation += 0.25 + 0.08 * np.sin(9.0 * east) * np.cos(4.0 * north)
    correlation[east + north > 2.6] = np.nan
    return CorrelationSurface(
        x_m=x,
        y_m=y,
        correlation=correlation,
        half_width_m=(1.8, 1.2),
        prior=(0.1, 0.05),
        prior_sigma_m=(0.5, 0.3),
        best=(0.42, -0.2),
        second=(-0.9, 0.5),
        truth=(0.44, -0.22),
        origin="the prior of scan 512",
        axes=("along", "cross"),
    )
