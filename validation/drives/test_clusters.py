"""Drives registered by a cluster: the same bits as by one process, though a worker dies; a thousand drives."""

import os
import signal
import threading
import time
from pathlib import Path

import pytest
from distributed import Client, LocalCluster

from batch.short_drives import Short, assert_same, make_short, register
from benchmarks.archive import FULL_ARCHIVE, run_archive
from canon.site import Site


@pytest.fixture(scope="module")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Short:
    return make_short(site, tmp_path_factory)


def cluster_of(workers: int) -> LocalCluster:
    return LocalCluster(n_workers=workers, threads_per_worker=1, processes=True, dashboard_address=None)


def test_a_cluster_gives_the_same_bits(short: Short, tmp_path: Path) -> None:
    out = tmp_path / "cluster"
    with cluster_of(2) as cluster:
        assert register(short.map, short.drives, out, "--scheduler", cluster.scheduler_address) == 0
    assert_same(out, short)


def test_a_cluster_gives_the_same_bits_though_a_worker_dies(short: Short, tmp_path: Path) -> None:
    out = tmp_path / "cluster"
    with cluster_of(2) as cluster:

        def kill_one() -> None:
            while not list(out.glob("jobs/*.json")):
                time.sleep(0.02)
            with Client(cluster.scheduler_address, set_as_default=False) as client:
                os.kill(next(iter(client.run(os.getpid).values())), signal.SIGKILL)

        killer = threading.Thread(target=kill_one)
        killer.start()
        assert register(short.map, short.drives, out, "--scheduler", cluster.scheduler_address) == 0
        killer.join()
    assert_same(out, short)


def test_a_thousand_drives(tmp_path: Path) -> None:
    outcome = run_archive(FULL_ARCHIVE, tmp_path, print)
    for record in outcome.records:
        print(record)
    assert not outcome.not_measured
    unlike = {record.key: record.value for record in outcome.records if "unlike" in record.key}
    assert len(unlike) == 5
    assert set(unlike.values()) == {0.0}
    assert all(record.met for record in outcome.records if record.goal is not None)
