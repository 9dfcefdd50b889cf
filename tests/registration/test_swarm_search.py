"""The search by a particle swarm: from anywhere in five dimensions to the places of the exhaustive search."""

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from canon.site import Site
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, DriveWriter, MapFile
from lgprjax.pso import SwarmConfig, run_swarm
from lgprjax.registration import SEARCH_SWARM, RegisterOptions


def first_metres(site: Site, name: str, folder: Path, scans: int = 170) -> Path:
    """The first 6 m of a drive."""
    path = folder / f"{name}.drive.h5"
    with DriveLog.open(site.logs[name]) as log:
        traces, _ = log.read_traces(0, scans)
        with DriveWriter.create(path, log.description, channels=log.channels, dtype=np.uint8) as writer:
            writer.append(log.scan_time_s[:scans], (traces + 128).astype(np.uint8))
    return path


def searched(site: Site, path: Path, swarm: SwarmConfig | None) -> RegisteredDrive:
    with MapFile.open(site.map) as source, DriveLog.open(path) as log:
        return register_log(source, log, RegisterOptions(search_m=1.5, search_swarm=swarm))


def ok_of(drive: RegisteredDrive) -> np.ndarray:
    return np.asarray(drive.table["code"].to_numpy() == "ok")


def test_places_are_those_of_the_exhaustive_search(site: Site, tmp_path: Path) -> None:
    path = first_metres(site, "live", tmp_path, scans=130)
    plain, swarm = searched(site, path, None), searched(site, path, SEARCH_SWARM)
    assert swarm.truth is not None
    error_m = np.hypot(*(np.asarray(swarm.fix.pose) - swarm.truth)[:, :2].T)
    assert error_m[ok_of(swarm)].max() < 0.3
    assert ok_of(swarm).mean() > ok_of(plain).mean() - 0.15
    both = ok_of(plain) & ok_of(swarm)
    assert np.mean((plain.fix.window_m == swarm.fix.window_m)[both]) > 0.9
    apart_m = np.hypot(*(np.asarray(swarm.fix.pose) - np.asarray(plain.fix.pose))[both, :2].T)
    assert np.quantile(apart_m, 0.99) < 0.02
    assert np.all(swarm.fix.p_false[ok_of(swarm)] <= 1e-4)


@pytest.mark.parametrize("neighbours", [2, None])
def test_both_topologies_find_a_peak(neighbours: int | None) -> None:
    peak = jnp.asarray([0.3, -0.6, 0.1], dtype=jnp.float32)
    start = jax.random.uniform(jax.random.key(1), (32, 3), minval=-1.0, maxval=1.0)
    config = SwarmConfig(particles=32, iterations=60, neighbours=neighbours)
    found = run_swarm(
        jax.random.key(2), start, lambda at: -jnp.sum((at - peak[None]) ** 2, axis=1), jnp.ones(3, bool), config=config
    )
    np.testing.assert_allclose(np.asarray(found.position), np.asarray(peak), atol=0.02)
