"""Labels made consistent: honest covariances, wrong fixes in runs of every length, and time and memory."""

import time
import tracemalloc
from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import chi2

from lgprjax.navigation.pose_graph import LabelChain, solve_graph
from looped_drives import fixes_between, looped_drives
from navigation.test_pose_graph import MODEL, check_wrong, left_m, mutual_rms_m


def test_errors_are_as_large_as_the_covariances_say(record_property: Callable[[str, object], None]) -> None:
    """Label errors drawn from the process itself, by its dense covariance: the mean NEES within its 99.9 % interval."""
    at = np.arange(0.0, 121.0)
    d = np.sqrt(3.0) * np.abs(at[:, None] - at[None]) / MODEL.length_m
    smooth = np.linalg.cholesky((1.0 + d) * np.exp(-d) + 1e-10 * np.eye(len(at)))
    yaw = 0.2 + at / 80.0
    pose = np.stack([80.0 * np.sin(yaw), -80.0 * np.cos(yaw), yaw], axis=1)
    chains = (LabelChain(0.0, 120.0, 0.5), LabelChain(0.0, 120.0, 0.5))
    ends = np.array([(1, p, 0, p) for p in range(0, 121, 2)])
    chain, asked = np.array([0, 0, 1, 1]), np.array([16.0, 80.0, 40.0, 110.0])
    nees = []
    for seed in range(25):
        rng = np.random.default_rng([seed, 9])
        wrong = []
        for _ in chains:
            steps = rng.normal(size=(len(at), 3)) * [MODEL.walk_m, MODEL.walk_m, MODEL.walk_yaw_rad]
            walk = np.cumsum(steps, axis=0)
            drawn = smooth @ rng.normal(size=(len(at), 3)) * [0.5, 0.5, MODEL.sigma_yaw_rad]
            wrong.append(drawn + walk - walk[0])
        labels = [pose + each for each in wrong]
        solution = solve_graph(chains, fixes_between(rng, [pose, pose], labels, ends, 0.02), MODEL)
        left = np.array([wrong[c][round(a)] for c, a in zip(chain, asked, strict=True)])
        left = (left + solution.correction(chain, asked)).reshape(-1)
        nees.append(float(left @ np.linalg.solve(solution.covariance(chain, asked), left)))
    record_property("nees_of_12", round(float(np.mean(nees)), 2))
    low, high = chi2.interval(0.999, 12 * len(nees))
    assert low / len(nees) <= np.mean(nees) <= high / len(nees)


@pytest.mark.parametrize(("run", "shift_m"), [(1, (0.3, 3.0)), (20, (0.3, 1.0)), (8, (0.1, 0.3))], ids=str)
def test_wrong_fixes_do_not_bend_it(
    run: int, shift_m: tuple[float, float], record_property: Callable[[str, object], None]
) -> None:
    drives = looped_drives(1)
    rms, most, kept = check_wrong(drives, solve_graph(drives.chains, drives.edges, MODEL), run, shift_m)
    record_property("changed_rms_m", round(rms, 4))
    record_property("changed_at_most_m", round(most, 4))
    record_property("wrong_kept", round(kept, 3))


@pytest.mark.parametrize("count", [3, 10])
def test_time_and_memory(count: int, record_property: Callable[[str, object], None]) -> None:
    drives = looped_drives(2, drives=count)
    tracemalloc.start()
    began = time.perf_counter()
    solution = solve_graph(drives.chains, drives.edges, MODEL)
    record_property("seconds", round(time.perf_counter() - began, 1))
    record_property("peak_mb", round(tracemalloc.get_traced_memory()[1] / 1e6))
    tracemalloc.stop()
    mutual = mutual_rms_m(drives, left_m(drives, solution))
    record_property("unknowns", len(solution.state))
    record_property("fixes", len(drives.edges.found))
    record_property("mutual_m", round(mutual, 4))
    assert mutual <= 0.05
