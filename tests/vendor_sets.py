"""Small recordings of one line, as each vendor would have written them."""

from pathlib import Path

import h5py
import numpy as np
import segyio

COUNTS = np.random.default_rng(8).integers(-30000, 30000, (12, 40))
_POSITIONS_CM = 1000 + 5 * np.arange(12)


def write_mala_pair(folder: Path, suffix: str) -> list[Path]:
    """A MALA line of either width, its ``.rad`` beside it."""
    path = folder / f"line{suffix}"
    path.write_bytes(COUNTS.astype("<i4" if suffix == ".rd7" else "<i2").tobytes())
    header = "SAMPLES:40\r\nFREQUENCY:5000\r\nDISTANCE INTERVAL: 0.05\r\nTIMEWINDOW:8\r\nLAST TRACE:12\r\n"
    path.with_suffix(".rad").write_text(header)
    return [path]


def write_iprb(folder: Path) -> list[Path]:
    """Two channels of an ImpulseRadar array."""
    paths = [folder / f"SITE_001_A{number:02}.iprb" for number in (1, 2)]
    for number, path in enumerate(paths):
        path.write_bytes(COUNTS.astype("<i2").tobytes())
        path.with_suffix(".iprh").write_text(
            "DATA VERSION: 16\nANTENNA: 600 MHz\nSAMPLES: 40\nFREQUENCY: 5000\nTIMEWINDOW: 8\nLAST TRACE: 12\n"
            f"DISTANCE INTERVAL: 0.05\nCHANNELS: 2\nCH_X_OFFSET: {0.08 * number}\nCH_Y_OFFSET: 0\n"
        )
    return paths


def write_segy(folder: Path, interval: int = 200) -> list[Path]:
    """A line in centimetres; ``interval``: ps, as its headers have it."""
    path = folder / "line.sgy"
    spec = segyio.spec()
    spec.format, spec.samples, spec.tracecount = 3, np.arange(40), 12
    with segyio.create(str(path), spec) as store:
        store.bin[3217] = interval
        for index in range(12):
            store.trace[index] = COUNTS[index].astype("i2")
            store.header[index] = {71: -100, 73: int(_POSITIONS_CM[index]), 77: 100, 117: interval}
    return [path]


def write_gprmax(folder: Path) -> list[Path]:
    """The traces of one simulated B-scan, a file each."""
    paths = [folder / f"scan{i + 1}.out" for i in range(12)]
    pulse = np.exp(-(((np.arange(400) * 0.02 - 3) / 0.6) ** 2))
    for i, path in enumerate(paths):
        with h5py.File(path, "w") as store:
            store.attrs["dt"] = 2e-11
            store["rxs/rx1/Ez"] = (pulse * (1 + i)).astype("f4")
            store["rxs/rx1"].attrs["Position"] = [0.4 + 0.05 * i, 0.5, 0.0]
            store.create_group("srcs/src1").attrs["Position"] = [0.2 + 0.05 * i, 0.5, 0.0]
    return paths


def write_cmu(folder: Path) -> list[Path]:
    """A sequence of the CMU-GPR data set."""
    run_dir = folder / "1613065150-0-gates_g-cmu-gpr"
    run_dir.mkdir()
    times = 1613065150 + 0.1 * np.arange(12)
    rows = "\n".join(f"{t:.3f},{','.join(map(str, row))}" for t, row in zip(times, COUNTS, strict=True))
    (run_dir / "gpr_meas.csv").write_text(f"t_stamp,{','.join(f'amp_{i}' for i in range(40))}\n{rows}\n")
    odometry = "\n".join(f"{t:.3f},{0.05 * i:.3f}" for i, t in enumerate(times))
    (run_dir / "we_odom.csv").write_text(f"t_stamp,dist_x\n{odometry}\n")
    return [run_dir]
