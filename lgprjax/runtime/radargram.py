"""A live radargram of the middle channel: scans in, columns of grey values out."""

import numpy as np
from jaxtyping import Float, UInt8

from lgprjax.wire import Frame, decode

ROWS = 120
"""Grey values of a column, from the first sample down."""
_MEAN_SHARE = 0.02


def middle_trace(frame: Frame) -> Float[np.ndarray, " sample"]:
    """The middle channel of a scan over travel time; of a sweep, the magnitude of its transform."""
    if frame.name == "radar_sweep":
        from lgprjax.formats import complex_rows  # the process of the page needs no HDF5 otherwise

        rows = complex_rows(frame)
        return np.asarray(np.abs(np.fft.ifft(rows[(len(rows) - 1) // 2] / np.maximum(np.abs(rows[-1]), 1e-12))))
    channels, samples = int(frame.number("channels")), int(frame.number("samples"))
    data = frame.fields["data"]
    assert isinstance(data, bytes)
    return np.asarray(np.frombuffer(data, np.uint8).reshape(channels, samples)[channels // 2], np.float64)


class LiveColumns:
    """The newest scan as a column: less the running mean, which hides the ground, in units of its spread."""

    def __init__(self) -> None:
        self._mean: Float[np.ndarray, " sample"] | None = None
        self._square = 0.0
        self._newest: Float[np.ndarray, " sample"] | None = None

    def take(self, raw: bytes) -> None:
        """A frame of a scan; an undecodable one is ignored."""
        try:
            self.add(middle_trace(decode(raw)))
        except (ValueError, KeyError, IndexError):
            return

    def add(self, trace: Float[np.ndarray, " sample"]) -> None:
        """The middle channel of a scan; one without finite samples is ignored."""
        if not len(trace) or not np.isfinite(trace).all():
            return
        if self._mean is None or len(self._mean) != len(trace):
            self._mean, self._square = trace.copy(), 0.0
        self._mean += _MEAN_SHARE * (trace - self._mean)
        self._newest = trace - self._mean
        self._square += _MEAN_SHARE * (float(np.mean(self._newest**2)) - self._square)

    def column(self) -> UInt8[np.ndarray, " row"] | None:
        """The newest scan, once; ``None`` without a new one."""
        newest, self._newest = self._newest, None
        if newest is None or self._square <= 0.0:
            return None
        at = np.linspace(0.0, len(newest) - 1.0, ROWS)
        scaled = np.interp(at, np.arange(len(newest)), newest) / (3.0 * np.sqrt(self._square))
        return np.asarray(np.clip(127.5 + 127.5 * scaled, 0.0, 255.0), np.uint8)
