"""A process of the runtime, started by the supervisor: ``python -m lgprjax.runtime.main NAME ...``."""

import argparse
import importlib
import sys
from collections.abc import Sequence
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.process import (
    PROCESSES,
    UNUSABLE_INPUT,
    Started,
    hold_to_cores,
    run_in_real_time,
    set_environment,
)
from lgprjax.runtime.service import die_with_parent

PROGRAMS = {
    "control": "lgprjax.runtime.control.program",
    "registration": "lgprjax.runtime.registration.program",
    "recorder": "lgprjax.runtime.recorder",
    "display": "lgprjax.runtime.display.program",
    "monitor": "lgprjax.runtime.monitor",
    "coverage": "lgprjax.runtime.coverage.program",
    "output": "lgprjax.runtime.output.program",
}
"""The module of a process, whose ``run`` is called. Only this one is imported, to keep processes small and fast to
start.
"""


def process_command(
    name: str, config: RuntimeConfig, rings: Path, run_folder: Path, after_death: bool
) -> tuple[str, ...]:
    """The command line of a process; ``after_death`` if it replaces one that died."""
    command = (sys.executable, "-P", "-m", "lgprjax.runtime.main", name, "--config", str(config.file))
    places = ("--rings", str(rings), "--run", str(run_folder))
    return (*command, *places, *(("--after-death",) if after_death else ()))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one process until it ends; its exit status: 0 for success, ``UNUSABLE_INPUT``."""
    parser = argparse.ArgumentParser(prog="lgprjax.runtime.main", description="One process of the onboard runtime.")
    parser.add_argument("name", choices=PROCESSES)
    parser.add_argument("--config", required=True, type=Path, help="CONFIG.toml of the run")
    parser.add_argument("--rings", required=True, type=Path, help="folder of the rings, in memory")
    parser.add_argument("--run", required=True, type=Path, help="folder of the run")
    parser.add_argument("--after-death", action="store_true", help="it replaces one that died")
    given = parser.parse_args(arguments)
    die_with_parent(given.name)
    try:
        config = read_config(given.config)
        hold_to_cores(given.name, config)
        set_environment(config)
        if given.name == "control" and config.control.realtime_priority is not None:
            run_in_real_time("control", config.control.realtime_priority, threads_too=True)
        program = importlib.import_module(PROGRAMS[given.name])
        program.run(Started(given.name, config, given.rings, given.run, given.after_death))
    except InputError as error:
        print(f"{given.name}: {error}", file=sys.stderr, flush=True)
        return UNUSABLE_INPUT
    return 0


if __name__ == "__main__":
    sys.exit(main())
