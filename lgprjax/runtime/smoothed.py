"""A recorded run of a skid-steer vehicle smoothed: its lines' bytes through the filter once more, forward and back."""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.coverage.resume import RoutePlace
from lgprjax.errors import InputError
from lgprjax.formats import read_run
from lgprjax.navigation import (
    DeltaHeading,
    GateRules,
    GnssObservation,
    SkidFilterState,
    SkidModel,
    SkidMotion,
    SkidObservations,
    SmoothedDrive,
    contradicted_m,
    init_skid_filter,
    smooth_skid,
    step_skid_filter,
)
from lgprjax.navigation.skid_model import skid_pose, skid_pose_covariance
from lgprjax.run_records import RecordKind, Source
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.senses import SkidSenses
from lgprjax.runtime.control.skid.setup import load_skid
from lgprjax.runtime.replay import starts_of_run
from lgprjax.worked.record import CoverRun

_PIECE = 16_384
"""Ticks that are smoothed at once: five and a half minutes; those after them are looked at as well."""
_AHEAD = 8_192
_NEAR_NS = 15_000_000


class SmoothedPoses(NamedTuple):
    """Poses of a run's ticks.

    Attributes:
        mono_ns: time of each tick, rising, ns.
        live, pose: x_m, y_m and yaw_rad, live and smoothed.
        covariance: covariance of the smoothed pose, enlarged by contradictions of later evidence.
    """

    mono_ns: Int[np.ndarray, " tick"]
    live: Float[np.ndarray, "tick 3"]
    pose: Float[np.ndarray, "tick 3"]
    covariance: Float[np.ndarray, "tick 3 3"]


def smooth_run(run: CoverRun) -> tuple[CoverRun, SmoothedPoses]:
    """A run with the poses of its moments smoothed, and the poses of all ticks.

    A moment without a known tick is unchanged.

    Args:
        run: run from ``read_cover_run``.

    Raises:
        InputError: the recording, or a file of the run, cannot be used.
    """
    folder = run.folder
    reading = read_run(folder)
    assert reading.clock is not None  # as the run could be read
    found = []
    for header, ticks in starts_of_run(folder):
        config = read_config(folder / "config.toml")
        config = config.model_copy(update={"file": Path(header["config"])})
        place = header.get("place")
        loaded = load_skid(
            config, None if place is None else RoutePlace(int(place[0]), float(place[1])), header.get("anchor")
        )
        for name, digest in header["hashes"].items():
            if loaded.hashes.get(name) != digest:
                raise InputError(
                    config.path(name),
                    "file",
                    f"the file used in the run, {digest[:12]}...",
                    "a changed or missing file",
                )
        senses, times, rows = SkidSenses(loaded.frame, config.sensors), [], []
        for tick in ticks:
            for record in tick.came:
                if record.kind is RecordKind.PORT_IN and record.source in (Source.DRIVE_BY_WIRE, Source.GNSS):
                    senses.take(record)
            heard, now_ns = senses.end_tick(tick.mono_ns), tick.mono_ns
            at, turn = heard.place, heard.turn
            fix = (0.0, 0.0, 1.0, 0.0, 0.0)
            if at is not None:
                fix = (at.x_m, at.y_m, at.reported_m**2, (now_ns - at.time_ns) / 1e9, 1.0)
            turned = (0.0, 0.0, 0.0) if turn is None else (turn.turn_rad, turn.span_s, 1.0)
            times.append(now_ns)
            rows.append((heard.step_s, heard.left_mps, heard.right_mps, *fix, *turned))
        numbers = np.array(rows, np.float32).reshape(len(rows), 11)
        begun = np.flatnonzero(numbers[:, 7] > 0.5)
        if len(begun):
            # The vehicle's filter begins with the first position, and with the tick that brings it.
            first = int(begun[0])
            found.append(_smoothed(loaded.setup.model, loaded.setup.rules, np.array(times[first:]), numbers[first:]))
    if not found:
        return run, SmoothedPoses(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3, 3)))
    whole = SmoothedPoses(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
    mono_ns = run.utc_ns - (reading.clock[0] - reading.clock[1])
    near = np.clip(np.searchsorted(whole.mono_ns, mono_ns - _NEAR_NS), 0, len(whole.mono_ns) - 1)
    known = (np.abs(whole.mono_ns[near] - mono_ns) <= _NEAR_NS) & np.isfinite(whole.pose[near]).all(axis=1)
    smoothed = run.rows.copy()
    for column, name in enumerate(("x_m", "y_m", "yaw_rad")):
        smoothed[name][known] = whole.pose[near[known], column]
    smoothed["covariance"][known] = whole.covariance[near[known]]
    provenance = {**run.provenance, "poses": "smoothed forward and backward"}
    return run._replace(rows=smoothed, provenance=provenance), whole


def _smoothed(model: SkidModel, rules: GateRules, times: np.ndarray, numbers: np.ndarray) -> SmoothedPoses:
    state = init_skid_filter(model, jnp.float32(numbers[0, 3]), jnp.float32(numbers[0, 4]))
    parts = []
    for begin in range(0, len(numbers), _PIECE):
        part = numbers[begin : begin + _PIECE + _AHEAD]
        # Ticks of no length without observations change nothing.
        padded = np.concatenate([part, np.zeros((_PIECE + _AHEAD - len(part), 11), np.float32)])
        drive = _smooth(model, rules, state, jnp.asarray(padded))
        kept = min(_PIECE, len(part))
        wrong = contradicted_m(drive)[:kept]
        covariance = np.asarray(skid_pose_covariance(drive.smoothed), np.float64)[:kept]
        covariance[:, 0, 0] += wrong**2
        covariance[:, 1, 1] += wrong**2
        both = (skid_pose(each) for each in (drive.filtered, drive.smoothed))
        poses = (np.stack([np.asarray(part, np.float64) for part in each], axis=1)[:kept] for each in both)
        parts.append((times[begin : begin + kept], *poses, covariance))
        state = _advance(model, rules, state, jnp.asarray(padded[:_PIECE]))
    return SmoothedPoses(*(np.concatenate(each) for each in zip(*parts, strict=True)))


@jax.jit
def _smooth(
    model: SkidModel, rules: GateRules, state: SkidFilterState, numbers: Float[Array, "tick 11"]
) -> SmoothedDrive:
    return smooth_skid(model, rules, state, *_observed(numbers))


@jax.jit
def _advance(
    model: SkidModel, rules: GateRules, state: SkidFilterState, numbers: Float[Array, "tick 11"]
) -> SkidFilterState:
    def step(state: SkidFilterState, tick: tuple[SkidMotion, SkidObservations]) -> tuple[SkidFilterState, None]:
        return step_skid_filter(model, rules, state, *tick)[0], None

    after: SkidFilterState = jax.lax.scan(step, state, _observed(numbers))[0]
    return after


def _observed(numbers: Float[Array, "tick 11"]) -> tuple[SkidMotion, SkidObservations]:
    step, left, right, x, y, variance, age, valid, turn, span, turned = numbers.T
    fix = GnssObservation(x, y, variance[:, None, None] * jnp.eye(2, dtype=jnp.float32)[None], age, valid > 0.5)
    return SkidMotion(left, right, step), SkidObservations(fix, DeltaHeading(turn, span, turned > 0.5))
