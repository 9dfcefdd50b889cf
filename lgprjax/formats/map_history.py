"""What a map's provenance says of its baselines and updates."""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.formats.map_file import MapFile


class MapHistory(NamedTuple):
    """What a map's provenance says of its baselines.

    Attributes:
        inputs: one row a baseline, empty where nothing is said.
        updates: rows of the updates so far.
        agreement: median strength of the matches of its first baselines, as far as that has been measured.
        repeats: share of each baseline's signal that is ground; NaN where not measured.
    """

    inputs: tuple[dict[str, Any], ...]
    updates: tuple[object, ...]
    agreement: Float[np.ndarray, "known known"]
    repeats: Float[np.ndarray, " drive"]

    @staticmethod
    def of(source: MapFile) -> "MapHistory":
        """History of a map."""
        drives = len(source.description.label_sigma_m)
        said, done = source.provenance.get("inputs"), source.provenance.get("updates")
        rows = [row if isinstance(row, dict) else {} for row in (said if isinstance(said, list) else [])][:drives]
        rows += [{}] * (drives - len(rows))
        agreement = _numbers(source.provenance.get("agreement"))
        square = agreement.ndim == 2 and agreement.shape[0] == agreement.shape[1]
        return MapHistory(
            inputs=tuple(rows),
            updates=tuple(done) if isinstance(done, list) else (),
            agreement=agreement if square else np.zeros((0, 0)),
            repeats=np.array([_number(row.get("repeats")) for row in rows]),
        )

    @property
    def added_by(self) -> tuple[int, ...]:
        """Number of the update that each baseline came with, 0 for those that the map was built from."""
        return tuple(int(row.get("update") or 0) for row in self.inputs)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def _numbers(rows: object) -> Float[np.ndarray, "..."]:
    """A table of numbers and nulls; an empty one where it is none."""
    if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == len(rows) for row in rows):
        return np.zeros((0, 0))
    return np.array([[_number(value) for value in row] for row in rows]).reshape(len(rows), len(rows))
