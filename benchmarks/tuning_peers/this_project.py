"""This project's study: look-ahead from logs, from the files to the schedule, as ``lgprjax tune`` runs it.

``python -m benchmarks.tuning_peers.this_project OUT LOGS PROBLEM --draws N --steps N --repeats N --threads N``.
"""

import argparse
import json
import time
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.process import hold_to
from benchmarks.rollout_peers.work import peak_rss_mb, seconds
from benchmarks.tuning_problem import VEHICLE, TuningProblem, save_tuning
from lgprjax.formats import Study, read_vehicle
from lgprjax.recordings.vehicles import chassis_of, servo_of
from lgprjax.tuning.logged_look_ahead import DrawnVehicles, drawn_vehicles, judge_drawn
from lgprjax.tuning.loop import LoopLogs, draw_loops
from lgprjax.tuning.loop_fit import fit_loop
from lgprjax.tuning.studies.drives import loop_drive, loop_logs
from lgprjax.tuning.studies.logs import Task
from lgprjax.tuning.studies.look_ahead import LoggedLookAheadStudy
from lgprjax.tuning.studies.steering import FinishedStudy, run_study
from lgprjax.vehicle import ProportionalRear, look_ahead_m, stretched_look_ahead

_AT_ONCE = 512


def read_loop_logs(logs: tuple[Path, ...]) -> LoopLogs:
    """The drives as the fit takes them."""
    vehicle = read_vehicle(VEHICLE)
    task = Task(_study(logs, {}), vehicle, (), ())
    return loop_logs([loop_drive(task, path, fixes=False) for path in logs], servo_of(vehicle, VEHICLE))


def _study(logs: tuple[Path, ...], options: dict[str, Any]) -> Study:
    return Study(Path("look_ahead.toml"), "look_ahead", "look_ahead", VEHICLE, None, logs, (), options)


def problem_of(finished: FinishedStudy, logs: LoopLogs, draws: int) -> tuple[TuningProblem, DrawnVehicles]:
    """What the study found, for its peers, and the vehicles that it drew."""
    study = finished.outcome.detail
    assert isinstance(study, LoggedLookAheadStudy)
    fit, trials, tuned = study.fit, study.trials, study.tuned
    believed = chassis_of(read_vehicle(VEHICLE), VEHICLE)
    drawn = draw_loops(fit.prior, fit.posterior, jax.random.key(0), count=draws)
    shares, speeds = jnp.asarray(tuned.shares, jnp.float32), jnp.asarray(tuned.speeds_mps, jnp.float32)
    ahead = look_ahead_m(
        stretched_look_ahead(tuned.schedule.look_ahead, tuned.schedule.exponent, shares[None, :], jnp.min(shares)),
        speeds[:, None],
    )
    assert isinstance(believed.rear, ProportionalRear)
    law = (believed.wheelbase_m, believed.anchor_m, believed.rear.ratio, believed.largest_angle_rad)
    first, second = trials.paths
    problem = TuningProblem(
        **{name: np.asarray(field) for name, field in (logs._asdict() | fit.prior._asdict()).items()},
        found=np.array([one.value for one in fit.numbers.values()]),
        sigma=np.array([one.sigma for one in fit.numbers.values()]),
        draws=np.asarray(drawn),
        believed=np.array([*(float(v) for v in law), float(believed.characteristic_speed_mps)]),
        ahead_m=np.asarray(ahead),
        speeds_mps=np.asarray(tuned.speeds_mps),
        shares=np.asarray(tuned.shares),
        offsets_m=np.array(trials.offsets_m),
        rows_0=np.asarray(first.rows),
        rows_1=np.asarray(second.rows),
        paths=np.array([[float(p.spacing_m), float(p.length_m), float(p.laps_per_m)] for p in trials.paths]),
        settings=np.array(
            [
                round(trials.duration_s / trials.step_s),
                trials.step_s,
                trials.effort_m2,
                np.ceil(trials.longest_delay_s / trials.step_s),
            ]
        ),
        cost_m=np.asarray(tuned.judged.cost_m),
    )
    return problem, drawn_vehicles(believed, fit.prior, drawn)


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.tuning_peers.this_project")
    parser.add_argument("out", type=Path)
    parser.add_argument("logs", type=Path)
    parser.add_argument("problem", type=Path)
    for name in ("--draws", "--steps", "--repeats", "--threads"):
        parser.add_argument(name, type=int, required=True)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    files = tuple(sorted(chosen.logs.glob("*.drive.h5")))
    asked = _study(files, {"draws": float(chosen.draws), "steps": float(chosen.steps)})
    taken_s, cpu_s = [], []
    for _ in range(1 + chosen.repeats):
        begin, begin_cpu = time.perf_counter(), time.process_time()
        finished = run_study(asked)
        taken_s.append(time.perf_counter() - begin)
        cpu_s.append(time.process_time() - begin_cpu)
    logs = read_loop_logs(files)
    study = finished.outcome.detail
    problem, vehicles = problem_of(finished, logs, chosen.draws)
    save_tuning(chosen.problem, problem)
    schedule, shares = study.tuned.schedule, jnp.asarray(study.tuned.shares, jnp.float32)
    judge = jax.jit(partial(judge_drawn, trials=study.trials, schedule=schedule, shares=shares))

    def every() -> None:
        for low in range(0, chosen.draws, _AT_ONCE):
            chassis, servo = jax.tree.map(lambda field, low=low: field[low : low + _AT_ONCE], vehicles[:2])
            jax.block_until_ready(judge(DrawnVehicles(chassis, servo, vehicles.believed)))

    figures = {
        "first_s": taken_s[0],
        "taken_s": taken_s[1:],
        "cpu_s": min(cpu_s[1:]),
        "fit_s": min(seconds(lambda: fit_loop(study.fit.prior, logs), chosen.repeats)),
        "judge_s": min(seconds(every, chosen.repeats)),
        "logs": len(files),
        "driven_s": float(np.sum(np.any([problem.front_used, problem.yaw_used], axis=0))) * 0.02,
        "draws": chosen.draws,
        "threads": chosen.threads,
        "peak_rss_mb": peak_rss_mb(),
    }
    chosen.out.write_text(json.dumps(figures), encoding="utf-8")


if __name__ == "__main__":
    main()
