"""Runs gprMax as an outside program, in an environment of its own; nothing of it is imported here.

gprMax (GPL) computes Maxwell's equations on a grid of cells: no rays, no single scattering, and none of this
project's formulae.
"""

import os
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest
from jaxtyping import Float

from validation.full_wave.fdtd_model import Model, write_input

VARIABLE = "LGPRJAX_GPRMAX"
_LIMIT_S = 900.0  # for one model; the longest takes two minutes on one core


class Recording(NamedTuple):
    """What the receiver heard: the field along the dipole, time counted from the first step."""

    field: Float[np.ndarray, "trace time"]
    step_ns: float


Fdtd = Callable[[str, Model, Sequence[float]], Recording]


def find_gprmax() -> Path:
    """Python of the environment that gprMax lives in; skips the test where none is named."""
    named = os.environ.get(VARIABLE)
    if not named:
        pytest.skip(
            f"NOTHING WAS COMPARED with gprMax: {VARIABLE} does not name the Python that has it (`make gprmax` does)"
        )
    found = subprocess.run([named, "-c", "import gprMax"], capture_output=True, text=True, check=False)
    if found.returncode != 0:
        pytest.fail(f"{VARIABLE}={named} cannot import gprMax: {found.stderr.strip().splitlines()[-1:]}")
    return Path(named)


def record(python: Path, folder: Path, name: str, model: Model, antenna_m: Sequence[float]) -> Recording:
    """Computes one trace for each place of the antenna; the files go into ``folder``."""
    file = folder / f"{name}.in"
    write_input(model, antenna_m, file)
    command = [str(python), "-m", "gprMax", file.name, "--hide-progress-bars"]
    threads = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        command, cwd=folder, env=threads, capture_output=True, text=True, timeout=_LIMIT_S, check=False
    )
    outputs = sorted(folder.glob(f"{name}[0-9]*.h5"), key=lambda p: int(p.stem.removeprefix(name))) or [
        folder / f"{name}.h5"
    ]
    if done.returncode != 0 or len(outputs) != len(antenna_m):
        pytest.fail(f"gprMax on {name}.in ended with {done.returncode}: {(done.stdout + done.stderr)[-2000:]}")
    traces, step_s = [], 0.0
    for output in outputs:
        with h5py.File(output) as content:
            traces.append(content["rxs/rx1/Ez"][:].astype(np.float64))
            step_s = float(content.attrs["dt"])
    return Recording(np.stack(traces), step_s * 1e9)


def subtract(recording: Recording, background: Recording) -> Recording:
    """The echoes alone: one background for all traces, or one each."""
    assert recording.step_ns == background.step_ns
    return recording._replace(field=recording.field - background.field)
