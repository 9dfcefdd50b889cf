"""Ten thousand damages of every kind of vendor, side and field file, and large ones in little memory."""

import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from formats.samples import dzt_header, write_dt1, write_iprb, write_mala
from formats.segy_sample import write_segy
from formats.side_samples import cor_row, dzg_text, gga, gps_text
from validation.damage.vendor_files import SUBJECTS, TRACES, Subject, check_damages, side, trial


@pytest.mark.parametrize("name", SUBJECTS)
def test_damaged_files_are_read_or_refused(
    name: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    for how, count in check_damages(name, 10_000 if SUBJECTS[name].fatal else 1_000, tmp_path).items():
        record_property(how, count)


@pytest.mark.parametrize("name", [name for name in SUBJECTS if SUBJECTS[name].read is Subject._field_defaults["read"]])
def test_memory_follows_the_size_of_large_files(name: str, tmp_path: Path) -> None:
    """What the readers need besides their files is little beside these, whose lines are checked one by one here."""
    traces = np.tile(TRACES, (25, 20))
    make: dict[str, Callable[[Path], Path]] = {
        "a.DT1": lambda path: write_dt1(path, traces),
        "a.DZT": lambda path: _large_dzt(path, traces),
        "a.rd3": lambda path: write_mala(path, traces.astype("<i2")),
        "a.iprb": lambda path: write_iprb(path, traces),
        "a.sgy": lambda path: write_segy(path, traces),
        "a.GPS": side(gps_text([[gga(n)] for n in range(1_000)])),
        "a.DZG": side(dzg_text({n: [gga(n)] for n in range(1_000)})),
        "a.cor": side("".join(cor_row(n) for n in range(1, 2_000))),
        "topo_a.txt": side("N,E,Z\r\n" + "12.5,1.25,10.04\r\n" * 6_000),
        "a.xyz": side("267918.654 4178496.403 1206.46\n" * 3_000),
    }
    path = make[name](tmp_path / name)
    assert path.stat().st_size > 80_000
    trial(SUBJECTS[name].make(_folder(tmp_path / "small") / name), partial=False)
    (tmp_path / "large").mkdir()
    for each in (each for each in tmp_path.iterdir() if each.is_file()):
        each.rename(tmp_path / "large" / each.name)
    tracemalloc.start()
    try:
        assert trial(tmp_path / "large" / name, partial=False, longest_s=60.0) == ("read", "")
    finally:
        tracemalloc.stop()


def _folder(path: Path) -> Path:
    path.mkdir()
    return path


def _large_dzt(path: Path, traces: np.ndarray) -> Path:
    header = dzt_header(samples=traces.shape[1], bits=8)
    path.write_bytes(header + (traces // 256 + 128).astype("u1").tobytes())
    return path
