"""``lgprjax register --workers`` and ``--scheduler``: what is refused, in one line and before anything is written."""

import socket
import sys
from pathlib import Path

import pytest

from canon.site import Site
from lgprjax.batch import workers as worker_environment
from lgprjax.cli import main


def status_of(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--workers", "0"], "--workers: expected 1 to 4096, found 0"),
        (["--workers", "-2"], "--workers: expected 1 to 4096, found -2"),
        (["--workers", "2", "--threads", "0"], "--threads: expected 1 to 4096, found 0"),
        (["--workers", "2", "--scheduler", "tcp://localhost:1"], "expected one of them, found both"),
        (["--threads", "2"], "--threads: needs --workers or --scheduler as well"),
        (["--workers", "1", "--search-m", "0.2"], "--search-m"),
        (["--workers", "1", "--search-m", "100"], "--search-m: expected at most about "),
    ],
)
def test_options_that_make_no_sense(
    options: list[str], told: str, site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of("register", site.map, site.logs["live"], "-o", tmp_path / "out", *options) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_drives_of_one_name_are_refused(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "live.drive.h5"
    drives = (site.logs["live"], other)
    assert status_of("register", site.map, *drives, "-o", tmp_path / "out", "--workers", 1) == 1
    told = "live: drives: expected drives of different names, by which their fixes are named, found this name twice"
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_folder_of_another_map_is_refused(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "archive.json").write_text('{"map": "old.map.h5", "map_sha256": "0", "drives": []}')
    assert status_of("register", site.map, site.logs["live"], "-o", out, "--workers", 1) == 1
    assert "results of another map, old.map.h5" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == ["archive.json"]


def test_a_cluster_needs_its_package(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    arguments = ("-o", tmp_path / "out", "--scheduler", "tcp://localhost:1")
    assert status_of("register", site.map, site.logs["live"], *arguments) == 1
    err = capsys.readouterr().err
    assert 'pip install "lgprjax[batch]"' in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("foo://localhost:1", "unknown address scheme 'foo'"),
        ("tls://localhost:1", "TLS configuration"),
        ("tcp://localhost:PORT", "something that does not answer as one within 0.3 s"),
    ],
)
def test_an_address_of_no_scheduler_makes_no_client(
    address: str,
    told: str,
    site: Site,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("lgprjax.batch.workers._CONNECT_S", 0.3)
    monkeypatch.setattr("distributed.Client", None)  # its end, 20 s later, prints a traceback; or it waits for ever
    with socket.create_server(("localhost", 0)) as mute:
        address = address.replace("PORT", str(mute.getsockname()[1]))
        arguments = ("-o", tmp_path / "out", "--scheduler", address)
        assert status_of("register", site.map, site.logs["live"], *arguments) == 1
    err = capsys.readouterr().err
    assert f"--scheduler: {address}: expected a scheduler that answers, found " in err
    assert told in err
    assert len(err.splitlines()) == 1


def test_more_workers_than_gpus_are_refused(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("lgprjax.batch.folder.gpus", lambda: ["0", "1"])
    assert status_of("register", site.map, site.logs["live"], "-o", tmp_path / "out", "--workers", 3) == 2
    assert "--workers: expected at most 2, one a GPU, found 3" in capsys.readouterr().err


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
