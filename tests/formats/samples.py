"""Small drives and vendor files that the tests of this folder write themselves."""

import struct
from pathlib import Path

import numpy as np

from lgprjax.formats import (
    DriveDescription,
    DriveWriter,
    NavigationTrack,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
)
from lgprjax.radar.array import uniform_array


def make_track(records: int = 5, *, sigmas: bool = True) -> NavigationTrack:
    zeros = np.zeros(records)
    times = np.arange(records) * 0.5
    sigma = [zeros + 0.05] * 5 if sigmas else []
    return NavigationTrack(times, zeros + 42.5, zeros - 71.0 + 1e-6 * times, zeros + 3, zeros + 90, zeros, *sigma)


def make_description(*, channels: int = 3, samples: int = 8, sweeps: bool = False) -> DriveDescription:
    recording: TraceRecording | SweepRecording = TraceRecording(0.2, 1.5, 128.0, 2.5e8, samples)
    if sweeps:
        lookup = np.full((channels, samples), 1 + 2j, dtype=np.complex64)
        recording = SweepRecording(np.linspace(1e8, 4e8, samples), lookup, lookup[0])
    return DriveDescription(
        name="sample",
        t0_utc="2024-05-01T12:00:00Z",
        array=uniform_array(channels, 0.127, x_m=3.0, height_m=0.2, scan_period_s=0.008),
        recording=recording,
        navigation=make_track(),
        odometry=OdometryTrack(np.arange(4.0), np.array([0.0, 1.0, 0.5, 2.0])),
        truth=make_track(4, sigmas=False),
        vehicle={"time_s": np.arange(3.0), "mode": np.array([0, 1, 1], np.int8)},
        provenance={"made_by": "test", "steps": [1, 2]},
    )


def write_drive(path: Path, traces: np.ndarray | None = None, *, scans: int = 6) -> Path:
    """A drive of bytes, or of the given traces [scan, channel, sample]."""
    if traces is None:
        traces = np.random.default_rng(1).integers(0, 256, (scans, 3, 8), dtype=np.uint8)
    description = make_description(channels=traces.shape[1], samples=traces.shape[2])
    with DriveWriter.create(path, description, channels=traces.shape[1], dtype=traces.dtype) as writer:
        writer.append(np.arange(len(traces)) / 126, traces)
    return path


def write_dt1(
    path: Path,
    traces: np.ndarray,
    *,
    unit: str = "m",
    step: float = 0.05,
    start: float = 0.0,
    positions: np.ndarray | None = None,
    **lines: object,
) -> Path:
    """A pulseEKKO line; ``lines`` replace lines of the header, underscores standing for spaces.

    ``positions`` are those of the traces' headers, in place of ``start`` and ``step``.
    """
    count, samples = traces.shape
    positions = start + np.arange(count) * step if positions is None else positions
    header: dict[str, object] = {
        "NUMBER OF TRACES": count,
        "NUMBER OF PTS/TRC": samples,
        "TIMEZERO AT POINT": 1.25,
        "TOTAL TIME WINDOW": samples * 0.8,
        "STEP SIZE USED": step,
        "POSITION UNITS": unit,
        "NOMINAL FREQUENCY": 100.0,
    }
    header |= {name.replace("_", " "): value for name, value in lines.items()}
    text = "1234\r\nrecorded by a test\r\n" + "".join(f"{n:<19}= {v} \r\n" for n, v in header.items())
    path.with_suffix(".HD").write_text(text)
    with path.open("wb") as stream:
        for index, trace in enumerate(traces):
            words = np.zeros(32, "<f4")
            words[[0, 1, 2, 5]] = index + 1, positions[index], samples, 2
            stream.write(words.tobytes() + trace.astype("<i2").tobytes())
    return path


def dzt_header(
    *,
    tag: int = 0x0700,
    word: int = 1024,
    samples: int = 8,
    bits: int = 16,
    per_m: float = 50.0,
    position_ns: float = 0.0,
    range_ns: float = 4.0,
    channels: int = 1,
    permittivity: float = 0.0,
    antenna: bytes = b"400MHz",
) -> bytes:
    block = bytearray(1024)
    struct.pack_into("<4H", block, 0, tag, word, samples, bits)
    struct.pack_into("<5f", block, 10, 100.0, per_m, 0.0, position_ns, range_ns)
    struct.pack_into("<Hf", block, 52, channels, permittivity)
    block[98 : 98 + len(antenna)] = antenna
    return bytes(block)


def write_mala(path: Path, traces: np.ndarray, **lines: object) -> Path:
    """A MALA line; ``lines`` replace lines of the header, underscores standing for spaces."""
    header: dict[str, object] = {
        "SAMPLES": traces.shape[1],
        "FREQUENCY": 5000.0,
        "DISTANCE INTERVAL": 0.01,
        "ANTENNAS": " 500 MHz shielded",
        "TIMEWINDOW": traces.shape[1] * 0.2,
        "LAST TRACE": len(traces),
    }
    header |= {name.replace("_", " "): value for name, value in lines.items()}
    path.with_suffix(".rad").write_text("".join(f"{n}:{v}\r\n" for n, v in header.items()))
    path.write_bytes(traces.tobytes())
    return path


IPRB_TRACES = np.random.default_rng(4).integers(-30000, 30000, (5, 8))


def write_iprb(path: Path, traces: np.ndarray = IPRB_TRACES, *, bits: int = 16, **lines: object) -> Path:
    """An ImpulseRadar line; ``lines`` replace lines of the header, ``__`` a blank (``None`` leaves one out)."""
    header: dict[str, object] = {
        "HEADER VERSION": 20,
        "DATA VERSION": bits,
        "DATE": "2017-06-12",
        "START TIME": "14:48:13",
        "ANTENNA": "800 MHz",
        "SAMPLES": traces.shape[1],
        "FREQUENCY": 10240,
        "TIMEWINDOW": f"{traces.shape[1] / 10.24:.3f}",
        "LAST TRACE": len(traces),
        "TRIG SOURCE": "wheel",
        "TIME INTERVAL": "0.010",
        "DISTANCE INTERVAL": "0.009778",
        "USER DISTANCE INTERVAL": "0.010000",
        "ZERO LEVEL": 0,
        "CHANNELS": 1,
        "CH_X_OFFSET": 0.0,
        "CH_Y_OFFSET": 0.0,
    }
    header |= {name.replace("__", " "): value for name, value in lines.items()}
    text = "".join(f"{name}: {value}\r\n" for name, value in header.items() if value is not None)
    path.with_suffix(".iprh").write_text(text)
    path.write_bytes(traces.astype(f"<i{bits // 8}").tobytes())
    return path
