"""How a map stores its traces: orthonormal components of the gained traces, in few bits each.

What registration asks of a trace is its gained samples. They are turned into components that are uncorrelated over the
map (Karhunen and Loève), all of them, so that a later drive may look different, and each is rounded to whole steps. One
step holds for all components of a station: noise of equal power everywhere costs the fewest bits for what it does
(reverse water-filling, Cover and Thomas, ch. 10). The step is a share of the station's own RMS, so that quiet ground is
kept as well as loud ground. Components that hold less than the step become zeros and cost next to nothing.

The noise of rounding is step²/12 in each component that is not zero (Widrow 1961), so that a station's correlation with
itself as it was falls to about 1 / sqrt(1 + step_rms²/12). Gridding takes the mean of several stations: what is left of
the noise in a tile is a fraction of that.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int8

_MOST = 127
_LEAST_GAIN = 1e-9
"""Of the largest: below it nothing was ever kept of a depth."""


class MapPrecision(NamedTuple):
    """How closely traces are stored.

    Attributes:
        name: of the setting.
        step_rms: of rounding, in RMS values of a station's gained samples; None for samples as 16-bit floats.
    """

    name: str
    step_rms: float | None


FULL = MapPrecision("full", None)
STANDARD = MapPrecision("standard", 0.5)
SMALL = MapPrecision("small", 1.0)
MAP_PRECISIONS = {precision.name: precision for precision in (FULL, STANDARD, SMALL)}


class TraceCode(NamedTuple):
    """What a map's codes mean.

    Attributes:
        step_rms: see ``MapPrecision``.
        gain: depth gain of each profile sample.
        basis: orthonormal components of gained traces.
        level: RMS of the profiles at each depth before they were coded.
    """

    step_rms: float
    gain: Float[np.ndarray, " sample"]
    basis: Float[np.ndarray, "component sample"]
    level: Float[np.ndarray, " sample"]


class CodedTraces(NamedTuple):
    """Traces of stations in steps, and the step of each station."""

    codes: Int8[np.ndarray, "scan component channel"]
    scale: Float[np.ndarray, " scan"]


def trace_code(
    products: Float[np.ndarray, "sample sample"], traces: int, gain: Float[np.ndarray, " sample"], step_rms: float
) -> TraceCode:
    """The code that suits a map's traces.

    Args:
        products: sum over all traces of the product of each two samples, before the gain.
        traces: that were summed.
        gain: of the map.
        step_rms: of rounding.
    """
    weight = gain.astype(np.float64)
    _, vector = np.linalg.eigh(weight[:, None] * products * weight)
    level = np.sqrt(np.diag(products) / max(traces, 1))
    basis = np.ascontiguousarray(vector[:, ::-1].T)
    return TraceCode(step_rms, gain.astype(np.float32), basis.astype(np.float32), level.astype(np.float32))


def encode(
    code: TraceCode, profile: Float[np.ndarray, "scan channel sample"], valid: Bool[np.ndarray, "scan channel"]
) -> CodedTraces:
    """Traces in steps. A station with a spike beyond 127 steps gets as long a step as holds it: nothing is clipped."""
    gained = np.where(valid[..., None], profile, 0.0).astype(np.float32) * code.gain
    component = gained @ code.basis.T
    numbers = np.maximum(valid.sum(axis=1), 1) * profile.shape[2]
    rms = np.sqrt(np.sum(gained.astype(np.float64) ** 2, axis=(1, 2)) / numbers)
    peak = np.abs(component).max(axis=(1, 2), initial=0.0)
    # Few bits of the step itself, rounded up, so that it costs little.
    part, power = np.frexp(np.maximum(code.step_rms * rms, peak / _MOST))
    scale = np.ldexp(np.ceil(256.0 * part) / 256.0, power).astype(np.float32)
    steps = np.rint(component / np.where(scale > 0.0, scale, 1.0)[:, None, None])
    return CodedTraces(np.moveaxis(steps, 1, 2).astype(np.int8), scale)


def decode(code: TraceCode, coded: CodedTraces) -> Float[np.ndarray, "scan channel sample"]:
    """Profiles before the depth gain; zero where the gain is."""
    kept = code.gain > _LEAST_GAIN * float(code.gain.max())
    synthesis = code.basis * np.where(kept, 1.0 / np.where(kept, code.gain, 1.0), 0.0).astype(np.float32)
    steps = np.moveaxis(coded.codes, 1, 2).astype(np.float32) * coded.scale[:, None, None]
    return np.asarray(steps @ synthesis)
