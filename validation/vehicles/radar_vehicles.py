"""Hidden vehicles whose only positions against the map are radar fixes: drives rendered, registered and tuned.

Each vehicle has a survey, a second map that is displaced by 5 cm, a drive by hand and two of the autopilot on days of
clear weather, snow and rain. The studies read drive logs, fixes and a vehicle file that is wrong.
"""

import re
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

import lgprjax as lx
from canon.map import built_with_many_grounds
from lgprjax.errors import InputError
from lgprjax.formats import VehicleLog
from lgprjax.tuning.studies.loop import LoopStudy
from lgprjax.vehicle import look_ahead_m
from studies.commands import run

COUNT = 10
DISPLACED_M = 0.05
NAMES = ("lag_s", "rate_radps", "rear_ratio", "slip_s2pm2")
_TUNING = Path(__file__).parents[2] / "tuning"
_WEATHER = ("clear", "snow", "rain")
_DRIVEN = {"slow": (2.5, 3.0), "fast": (5.0, 7.0)}
"""Speed and look-ahead of the drives of the autopilot."""
_TRIED_S = np.geomspace(0.7, 2.5, 10)
"""Look-aheads in seconds of travel, for the best constant one."""
_DEGREE_M = 111_000.0


class Result(NamedTuple):
    """What the studies found of one vehicle.

    Attributes:
        inside: of lag, rate, k and slip, whether the 95 % interval holds the truth.
        told: which of them the drives determine.
        arcs: the same of k by arcs of fixes; ``None`` where the study refuses the drive.
        ok: share of scans with an accepted fix.
        tracking_m: largest difference of the RMS by fixes from that of the truth.
        predicted: largest relative difference of the RMS by rollout of the fit from the RMS by fixes.
        driven_m, tuned_m, best_m: true RMS offset of both drives: as driven, with the tuned look-ahead, with the best
            constant one for the true vehicle.
    """

    inside: dict[str, bool]
    told: dict[str, bool]
    arcs: bool | None
    ok: float
    tracking_m: float
    predicted: float
    driven_m: float
    tuned_m: float
    best_m: float


@cache
def result_of(number: int) -> Result:
    """Drive, map, register and tune one vehicle, in a folder of its own."""
    with TemporaryDirectory() as name:
        return _result(number, Path(name))


def _result(number: int, folder: Path) -> Result:
    draw = np.random.default_rng([number, 54])
    true = {
        "lag_s": draw.uniform(0.12, 0.3),
        "rate_radps": draw.uniform(0.12, 0.2),
        "rear": draw.uniform(0.35, 0.7),
        "characteristic_speed_mps": draw.uniform(12.0, 20.0),
        "delay_s": draw.uniform(0.04, 0.1),
    }
    text = (_TUNING / "radar_drives.toml").read_text(encoding="utf-8")
    for key, value in true.items():
        text = _set(text, key, value)
    text = text.replace("seed = 31", f"seed = {1000 + number}")
    days = [_WEATHER[(number + step) % 3] for step in (0, 1)]
    text = text.replace('"rain"', f'"{days[0]}"').replace('"snow"', f'"{days[1]}"')
    (folder / "drives.toml").write_text(text, encoding="utf-8")
    # Wrong within the widths of the study's prior.
    file = (_TUNING / "radar.vehicle.toml").read_text(encoding="utf-8")
    slip = max(true["characteristic_speed_mps"] ** -2 + 6e-4 * draw.normal(), 4e-4)
    stated = {
        "lag_s": true["lag_s"] * np.exp(0.3 * draw.normal()),
        "largest_wheel_rate_radps": true["rate_radps"] * np.exp(0.25 * draw.normal()),
        "rear_ratio": true["rear"] + 0.06 * draw.normal(),
        "characteristic_speed_mps": slip**-0.5,
        "delay_s": max(true["delay_s"] + 0.02 * draw.normal(), 0.0),
    }
    for key, value in stated.items():
        file = _set(file, key, value)
    vehicle = folder / "radar.vehicle.toml"
    vehicle.write_text(file, encoding="utf-8")
    _succeed("simulate", folder / "drives.toml", "-o", folder)
    # A survey whose base station is elsewhere: the same ground, 5 cm to the north.
    moved = f"latitude_deg = {42.0 + DISPLACED_M / _DEGREE_M:.9f}\n"
    (folder / "moved.toml").write_text(moved + text, encoding="utf-8")
    _succeed("simulate", folder / "moved.toml", "-o", folder / "moved", "--only", "survey")
    # A noise floor of each map's own takes minutes, and concerns false fixes, which the worlds validate.
    with built_with_many_grounds():
        sites = [lx.build_map(at / "survey.drive.h5", at / "course.map.h5") for at in (folder, folder / "moved")]
    logs = {name: folder / f"{name}.drive.h5" for name in ("hand", *_DRIVEN)}
    fixes = {name: lx.register(site, logs[name]) for name, site in zip(logs, (*sites, sites[0]), strict=True)}
    for each in fixes.values():
        each.save(folder)
    driven = [logs[name] for name in _DRIVEN]
    loop = lx.tune("loop", vehicle=vehicle, logs=driven).finished.outcome.detail
    assert isinstance(loop, LoopStudy)
    truths = (true["lag_s"], true["rate_radps"], true["rear"], true["characteristic_speed_mps"] ** -2)
    numbers = [loop.fit.numbers[name] for name in NAMES]
    offsets = {name: _offsets_m(logs[name]) for name in _DRIVEN}
    tracking = lx.tune("tracking", vehicle=vehicle, logs=driven).finished.outcome.figures
    seen = {figure.name.partition(".")[0]: figure.value for figure in tracking if "drive.h5: offset" in figure.name}
    rolled = [abs(_rms(one.rolled_m) / _rms(one.driven_m) - 1.0) for one in loop.predicted]
    schedule = lx.tune("look_ahead", vehicle=vehicle, logs=driven, draws=256, steps=60).vehicle.look_ahead
    assert schedule is not None
    chosen = {name: float(look_ahead_m(schedule, jnp.float32(speed))) for name, (speed, _) in _DRIVEN.items()}
    tuned = [_driven_again(folder, text, name, [chosen[name]])[0] for name in _DRIVEN]
    best = [min(_driven_again(folder, text, name, (speed * _TRIED_S).tolist())) for name, (speed, _) in _DRIVEN.items()]
    return Result(
        inside={name: one.low <= value <= one.high for name, one, value in zip(NAMES, numbers, truths, strict=True)},
        told={name: name in loop.fit.told for name in NAMES},
        arcs=_by_arcs(vehicle, logs["hand"], true["rear"]),
        ok=float(np.mean(np.concatenate([each.ok for each in fixes.values()]))),
        tracking_m=max(abs(seen[name] - _rms(offsets[name])) for name in _DRIVEN),
        predicted=max(rolled),
        driven_m=_mean_square([_rms(offsets[name]) for name in _DRIVEN]),
        tuned_m=_mean_square(tuned),
        best_m=_mean_square(best),
    )


def _by_arcs(vehicle: Path, log: Path, ratio: float) -> bool | None:
    try:
        found = lx.tune("rear_ratio", vehicle=vehicle, logs=log).finished.outcome.found["steering.rear_ratio"]
    except InputError:
        return None
    assert not isinstance(found, list)
    return found.low <= ratio <= found.high


def _driven_again(folder: Path, text: str, name: str, ahead_m: list[float]) -> list[float]:
    """True RMS offsets of a drive with other look-aheads, without a radar."""
    head, *drives = text.split("[[drive]]")
    (drive,) = (each for each in drives if f'name = "{name}"' in each)
    drive = re.sub(r"^radar = .*\n", "", drive, flags=re.M)
    many = [
        re.sub(r"^look_ahead_m = .*$", f"look_ahead_m = {ahead:.4f}", drive, flags=re.M).replace(
            f'"{name}"', f'"{name}_{place}"'
        )
        for place, ahead in enumerate(ahead_m)
    ]
    file, out = folder / "again.toml", folder / "again"
    file.write_text("[[drive]]".join([head, *many]), encoding="utf-8")
    _succeed("simulate", file, "-o", out, "--force")
    return [_rms(_offsets_m(out / f"{name}_{place}.drive.h5")) for place in range(len(ahead_m))]


def _offsets_m(log: Path) -> np.ndarray:
    """True offsets from the course while the autopilot steered."""
    plan = VehicleLog.open(log).plan
    assert plan is not None
    return np.asarray(plan["cross_track_m"][np.isfinite(plan["cross_track_m"])])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _mean_square(values: list[float]) -> float:
    return _rms(np.array(values))


def _set(text: str, key: str, value: float) -> str:
    """A TOML text with another number."""
    changed, count = re.subn(rf"^{key} = [-0-9.e]+", f"{key} = {value:.6g}", text, count=1, flags=re.M)
    assert count == 1, key
    return changed


def _succeed(*words: object) -> None:
    assert run(*words) == 0, words
