"""MCAP recordings that are damaged at many places; drives that are longer than what a process may hold."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formats.samples import make_description, make_track
from formats.test_mcap_damage import try_changed_bytes
from lgprjax.formats import DriveWriter, OdometryTrack, export_mcap


@pytest.mark.parametrize("seed", range(40))
def test_changed_bytes_are_refused_or_a_drive(seed: int, tmp_path: Path) -> None:
    try_changed_bytes(seed, 40, tmp_path)


def test_memory_does_not_grow_with_the_drive(tmp_path: Path) -> None:
    """Fifty MB more of scans, and a process that imports them needs no more."""
    peaks_kib, block = [], np.random.default_rng(1).integers(0, 256, (1000, 11, 369), dtype=np.uint8)
    for scans in (3000, 15000):
        time_s = np.arange(0.0, scans / 126.0 + 0.5, 0.5)
        description = replace(
            make_description(channels=11, samples=369),
            navigation=make_track(len(time_s)),
            odometry=OdometryTrack(time_s, time_s),
        )
        with DriveWriter.create(tmp_path / "a.drive.h5", description, channels=11, dtype=np.uint8) as writer:
            for first in range(0, scans, len(block)):
                writer.append(np.arange(first, first + len(block)) / 126.0, block)
        export_mcap(tmp_path / "a.drive.h5", tmp_path / "a.mcap", force=True)
        paths = f"{str(tmp_path / 'a.mcap')!r}, output={str(tmp_path / 'b.drive.h5')!r}"
        code = (
            f"import resource; from lgprjax.formats import import_mcap; import_mcap({paths}, force=True); "
            "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        peaks_kib.append(int(done.stdout))
        (tmp_path / "a.drive.h5").unlink()
    assert peaks_kib[1] < peaks_kib[0] + 12000


_LONG_DRIVE = """
import resource, sys
from pathlib import Path
import numpy as np
sys.path.insert(0, sys.argv[2])
from formats.samples import make_description
from lgprjax.formats import DriveLog, DriveWriter
peak_mib = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
path = Path(sys.argv[1]) / "a.drive.h5"
block = np.zeros((500, 11, 369), np.uint8)
before = peak_mib()
with DriveWriter.create(path, make_description(channels=11, samples=369), channels=11, dtype=np.uint8) as writer:
    for start in range(0, 60000, 500):
        writer.append(np.arange(start, start + 500) / 126, block)
with DriveLog.open(path) as log:
    assert sum(len(traces) for _, traces, _ in log.chunks(256)) == 60000
print(peak_mib() - before)
"""


def test_memory_does_not_grow_while_a_log_is_written_and_read(tmp_path: Path) -> None:
    tests = Path(__file__).parents[2] / "tests"
    command = [sys.executable, "-c", _LONG_DRIVE, str(tmp_path), str(tests)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tests.parent)
    # The traces are 232 MiB; the cache of chunks, a chunk read as float32 and the times fit in a quarter of that.
    assert float(done.stdout) < 60
