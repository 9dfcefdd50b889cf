"""A second master is refused, whatever name it has for the device, and the lock goes with its holder."""

import os
import subprocess
import sys
from pathlib import Path

from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.process import memory_folder, only_instance
from refusals import refused
from runtime.supervised_run import write_config

HOLD = """
import sys
from pathlib import Path
from lgprjax.runtime.config import read_config
from lgprjax.runtime.process import only_instance
with only_instance(read_config(sys.argv[1]), Path(sys.argv[2])):
    print("held", flush=True)
    sys.stdin.read()
"""


def config_of(folder: Path, device: str | None = None) -> RuntimeConfig:
    file = write_config(folder)
    if device is not None:
        file.write_text(file.read_text().replace(str(folder / "ttyDRIVE"), device))
    return read_config(file)


def locks() -> set[Path]:
    return set(memory_folder().glob("lgprjax-*.lock"))


def test_a_held_device_is_refused_by_the_number_of_its_holder(tmp_path: Path) -> None:
    config = config_of(tmp_path)
    with (
        only_instance(config, tmp_path / "a"),
        refused("ports.drive_by_wire.url", found=os.getpid()),
        only_instance(config, tmp_path / "b"),
    ):
        pass
    with only_instance(config, tmp_path / "b"):
        pass


def test_another_name_of_the_device_is_the_same_device(tmp_path: Path) -> None:
    (tmp_path / "ttyDRIVE").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyDRIVE")
    first = config_of(tmp_path)
    second = config_of(tmp_path, str(tmp_path / "by-id"))
    with (
        only_instance(first, tmp_path / "a"),
        refused("ports.drive_by_wire.url", found=os.getpid()),
        only_instance(second, tmp_path / "b"),
    ):
        pass


def test_a_run_folder_has_one_writer(tmp_path: Path) -> None:
    first = config_of(tmp_path)
    second = config_of(tmp_path, f"socket://127.0.0.1:{os.getpid()}")
    with (
        only_instance(first, tmp_path / "run"),
        refused(found=os.getpid()),
        only_instance(second, tmp_path / "." / "run"),
    ):
        pass
    # The refused one let go of what it had already.
    with only_instance(second, tmp_path / "b"):
        pass


def test_two_vehicles_do_not_disturb_each_other(tmp_path: Path) -> None:
    before = locks()
    first = config_of(tmp_path)
    second = config_of(tmp_path, str(tmp_path / "ttyOTHER"))
    with only_instance(first, tmp_path / "a"), only_instance(second, tmp_path / "b"):
        assert len(locks() - before) == 4
    assert not locks() - before


def test_a_killed_holder_holds_nothing(tmp_path: Path) -> None:
    config = config_of(tmp_path)
    root = str(Path(__file__).parents[2])
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(config.file), str(tmp_path / "run")],
        env={**os.environ, "PYTHONPATH": root},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        with refused("ports.drive_by_wire.url", found=holder.pid), only_instance(config, tmp_path):
            pass
        holder.kill()
    with only_instance(config, tmp_path / "run"):
        pass
