"""Traces of a subsurface database, read for the stations that are needed: as samples, or as codes."""

from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Float16, Int

from lgprjax.errors import InputError
from lgprjax.formats.map_code import CodedTraces, TraceCode, decode
from lgprjax.formats.map_rows import read_rows
from lgprjax.formats.map_stored import BLOCK
from lgprjax.formats.store import attribute_of, reading


class SampledTraces:
    """Traces as 16-bit samples.

    Attributes:
        code: none.
    """

    code: TraceCode | None = None

    def __init__(self, store: h5py.File, path: Path) -> None:
        self._traces, self._path = store["baselines/traces"], path

    def stored(self, stations: Int[np.ndarray, " scan"]) -> Float16[np.ndarray, "scan channel sample"]:
        """As they are in the file."""
        return read_rows(self._traces, self._path, stations)

    def profile(self, stations: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel sample"]:
        """Before the depth gain."""
        return self.stored(stations).astype(np.float32)


class CodedTraceBlocks:
    """Traces as codes, in blocks of 256 stations.

    Attributes:
        code: what they mean.
    """

    def __init__(self, store: h5py.File, path: Path) -> None:
        self._codes, self._scale, self._path = store["baselines/codes"], store["baselines/scale"], path
        step_rms = attribute_of(store["code"], "step_rms")
        assert isinstance(step_rms, int | float)
        self.code = TraceCode(float(step_rms), store["gain"][()], store["code/basis"][()], store["code/level"][()])
        blocks, due = len(self._codes), -(-len(self._scale) // BLOCK)
        if blocks != due:
            raise InputError(path, "/baselines/codes", f"{due} blocks of {BLOCK} stations", str(blocks))
        if not _orthonormal(self.code.basis):
            raise InputError(path, "/code/basis", "as many orthonormal components as samples", "others")

    def stored(self, stations: Int[np.ndarray, " scan"]) -> CodedTraces:
        """As they are in the file."""
        codes = np.zeros((len(stations), *self._codes.shape[1:3]), np.int8)
        for block in np.unique(stations // BLOCK):
            own = stations // BLOCK == block
            with reading(self._path, f"/baselines/codes, stations {block * BLOCK} to {(block + 1) * BLOCK - 1}"):
                codes[own] = np.moveaxis(self._codes[int(block)], -1, 0)[stations[own] - block * BLOCK]
        return CodedTraces(codes, read_rows(self._scale, self._path, stations))

    def profile(self, stations: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel sample"]:
        """Before the depth gain."""
        return decode(self.code, self.stored(stations))


def _orthonormal(basis: Float[np.ndarray, "component sample"]) -> bool:
    components, samples = basis.shape
    return components == samples and np.allclose(basis @ basis.T, np.eye(samples), atol=1e-3)
