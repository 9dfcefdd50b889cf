"""``lgprjax register --workers`` and ``--scheduler``: what is refused, in one line and before anything is written."""

import socket
import sys
from pathlib import Path

import pytest

from canon.commands import run
from canon.site import Site
from lgprjax.batch import workers as worker_environment


def test_options_that_make_no_sense(site: Site, short: Path, tmp_path: Path) -> None:
    for options, about, found in (
        ("--workers 0", "--workers", "0"),
        ("--workers -2", "--workers", "-2"),
        ("--workers 2 --threads 0", "--threads", "0"),
        ("--workers 2 --scheduler tcp://localhost:1", "--workers, --scheduler", ""),
        ("--threads 2", "--threads", ""),
        ("--workers 1 --search-m 0.2", "--search-m", "0.2"),
        ("--workers 1 --search-m 100", "--search-m", "100"),
    ):
        done = run("register", site.map, short, "-o", tmp_path / "out", *options.split())
        assert (done.status, done.about) == (2, about)
        assert found in done.err
        assert not (tmp_path / "out").exists()


def test_folders_and_drives_that_cannot_be(site: Site, short: Path, tmp_path: Path) -> None:
    """Two drives of one name; a folder with results of another map."""
    out = tmp_path / "out"
    done = run("register", site.map, short, tmp_path / short.name, "-o", out, "--workers", 1)
    assert (done.status, done.refusal.place, done.refusal.file) == (1, "drives", "short")
    assert not out.exists()
    out.mkdir()
    (out / "archive.json").write_text('{"map": "old.map.h5", "map_sha256": "0", "drives": []}')
    done = run("register", site.map, short, "-o", out, "--workers", 1)
    assert done.status == 1
    done.refusal.check(None, found="old.map.h5")
    assert [path.name for path in out.iterdir()] == ["archive.json"]


def test_a_cluster_needs_its_package(site: Site, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    done = run("register", site.map, short, "-o", tmp_path / "out", "--scheduler", "tcp://localhost:1")
    assert done.status == 1
    assert "lgprjax[batch]" in done.refusal.expected


@pytest.mark.parametrize(
    ("address", "value"),
    [("foo://localhost:1", "'foo'"), ("tls://localhost:1", "TLS"), ("tcp://localhost:PORT", "0.3 s")],
)
def test_an_address_of_no_scheduler_makes_no_client(
    address: str, value: str, site: Site, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lgprjax.batch.workers._CONNECT_S", 0.3)
    monkeypatch.setattr("distributed.Client", None)  # its end, 20 s later, prints a traceback; or it waits for ever
    with socket.create_server(("localhost", 0)) as mute:
        address = address.replace("PORT", str(mute.getsockname()[1]))
        done = run("register", site.map, short, "-o", tmp_path / "out", "--scheduler", address)
    assert done.status == 1
    assert done.about == f"--scheduler: {address}"
    assert value in done.err


def test_more_workers_than_gpus_are_refused(
    site: Site, short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lgprjax.batch.folder.gpus", lambda: ["0", "1"])
    done = run("register", site.map, short, "-o", tmp_path / "out", "--workers", 3)
    assert done.status == 2
    done.refusal.check("--workers", 2, found=3)


def test_a_worker_sees_its_own_gpu_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XLA_FLAGS", "--xla_dump_to=/nowhere")
    own = worker_environment.worker_environment(2, "1")
    assert own["CUDA_VISIBLE_DEVICES"] == "1"
    assert own["XLA_FLAGS"].split() == [
        *("--xla_dump_to=/nowhere", "--xla_cpu_multi_thread_eigen=true", "--xla_gpu_deterministic_ops=true")
    ]
    assert own["OMP_NUM_THREADS"] == own["NPROC"] == "2"
    assert "xla_gpu" not in worker_environment.worker_environment(1, None)["XLA_FLAGS"]


def test_gpus_are_those_that_the_environment_leaves(monkeypatch: pytest.MonkeyPatch) -> None:
    class Plugin:
        name = "xla_cuda13"

    monkeypatch.setattr(worker_environment, "entry_points", lambda group: [Plugin] if group == "jax_plugins" else [])
    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3, 5")
    assert worker_environment.gpus() == ["3", "5"]
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    assert worker_environment.gpus() == []
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "3")
    monkeypatch.setenv("JAX_PLATFORMS", "cpu")
    assert worker_environment.gpus() == []
