"""Resumed work of earlier runs: place, worked stretches and the worked map, one file in the run's folder."""

import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.field import CellGrid
from lgprjax.coverage.resume import Resumption, RoutePlace, WorkedStretch
from lgprjax.errors import InputError
from lgprjax.formats.store import atomic_output

_VERSION = 1


class TakenUp(NamedTuple):
    """Work of earlier runs by a plan.

    Attributes:
        plan_sha256: SHA-256 of the plan.
        resumption: place of resumption, and worked stretches beyond it.
        grid: grid of the map.
        probability: probability of each cell, by the best pass of any run.
        runs: UUID and number of moments, ``UUID:MOMENTS``, of the runs included; files of older programs have the UUID
            alone.
        shared_sigma_m: standard deviation per axis of the shared error used for the map; NaN if a file of an older
            program does not state it.
    """

    plan_sha256: str
    resumption: Resumption
    grid: CellGrid
    probability: Float[np.ndarray, "north east"]
    runs: tuple[str, ...]
    shared_sigma_m: float


def write_taken_up(path: Path, held: TakenUp) -> None:
    """Write the file atomically.

    Raises:
        InputError: the file cannot be written.
    """
    head = {
        "version": _VERSION,
        "plan_sha256": held.plan_sha256,
        "line": held.resumption.place.line,
        "along_m": held.resumption.place.along_m,
        "worked": [list(each) for each in held.resumption.worked],
        "grid": asdict(held.grid),
        "runs": list(held.runs),
        "shared_sigma_m": held.shared_sigma_m,
    }
    with atomic_output(path, force=True) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, head=np.array(json.dumps(head)), probability=held.probability.astype(np.float32))


def read_taken_up(path: Path) -> TakenUp:
    """Read it.

    Raises:
        InputError: missing, damaged, or of another version.
    """
    try:
        # NumPy leaves a damaged file open that it is given by name.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            head: dict[str, Any] = json.loads(str(file["head"]))
            probability = np.asarray(file["probability"], np.float32)
        if head["version"] != _VERSION:
            raise InputError(path, "version", str(_VERSION), str(head["version"]))
        grid = CellGrid(**head["grid"])
        worked = tuple(WorkedStretch(int(line), float(low), float(high)) for line, low, high in head["worked"])
        place = RoutePlace(int(head["line"]), float(head["along_m"]))
        shared_m = float(head.get("shared_sigma_m", "nan"))
        runs = tuple(head["runs"])
        held = TakenUp(str(head["plan_sha256"]), Resumption(place, worked), grid, probability, runs, shared_m)
    except FileNotFoundError:
        raise InputError(path, "file", "the worked area of earlier runs", "no such file") from None
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(
            path, "file", "the worked area of earlier runs, written by run --resume", repr(error)
        ) from None
    if held.probability.shape != held.grid.shape:
        raise InputError(path, "probability", f"{held.grid.shape} cells", f"{held.probability.shape}")
    return held
