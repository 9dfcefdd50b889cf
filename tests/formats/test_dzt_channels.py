"""DZT files of several channels against an independent reading of their bytes."""

import struct
from pathlib import Path

import numpy as np
import pytest

from formats.samples import dzt_header
from lgprjax.errors import InputError
from lgprjax.formats import read_dzt

_BIAS = {8: 128, 16: 32768, 32: 0}


def _written(path: Path, stored: np.ndarray, bits: int, *, word: int) -> Path:
    """Samples [scan, channel, sample] as stored; word 1024 and above are bytes, and then the header of each channel."""
    _, channels, samples = stored.shape
    header = b"".join(
        dzt_header(word=word, samples=samples, bits=bits, channels=channels, per_m=40.0) for _ in range(channels)
    )
    offset = 1024 * word if word < 1024 else max(word, 1024 * channels)
    path.write_bytes(header.ljust(offset, b"\0") + stored.astype({8: "u1", 16: "<u2", 32: "<i4"}[bits]).tobytes())
    return path


def _oracle(path: Path) -> list[list[list[int]]]:
    """Samples [channel][scan][sample] by ``struct`` alone, one value at a time."""
    data = path.read_bytes()
    word, samples, bits = struct.unpack_from("<3H", data, 2)
    (channels,) = struct.unpack_from("<H", data, 52)
    at = 1024 * word if word < 1024 else max(word, 1024 * channels)
    code, size = {8: ("B", 1), 16: ("H", 2), 32: ("i", 4)}[bits]
    lines: list[list[list[int]]] = [[] for _ in range(channels)]
    scan = 0
    while at < len(data):
        values = [struct.unpack_from(f"<{code}", data, at + size * i)[0] - _BIAS[bits] for i in range(samples)]
        values[0] = values[1] = 0
        lines[scan % channels].append(values)
        scan, at = scan + 1, at + size * samples
    return lines


@pytest.mark.parametrize("bits", [8, 16, 32])
@pytest.mark.parametrize(("channels", "word"), [(1, 1), (2, 2), (2, 1024), (3, 128), (4, 4096), (16, 16), (16, 1024)])
def test_channels(tmp_path: Path, bits: int, channels: int, word: int) -> None:
    rng = np.random.default_rng(bits + channels)
    low, high = (0, 2**bits) if bits < 32 else (-(2**31), 2**31)
    stored = rng.integers(low, high, (5, channels, 11))
    # The whole range: the least and the largest value come back as they are.
    stored[0, :, 2], stored[0, :, 3] = low, high - 1
    profile = read_dzt(_written(tmp_path / "a.DZT", stored, bits, word=word))
    oracle = np.array(_oracle(tmp_path / "a.DZT"), dtype=np.int64).transpose(1, 0, 2)
    np.testing.assert_array_equal(profile.channels.astype(np.int64), oracle)
    assert profile.channels.shape == (5, channels, 11)
    assert profile.positions_m is not None
    np.testing.assert_allclose(profile.positions_m, np.arange(5) / 40.0)


@pytest.mark.real
def test_real_files(real_data: Path) -> None:
    paths = sorted(real_data.rglob("*.DZT"))
    assert len(paths) >= 5
    for path in paths:
        with_channels = read_dzt(path).channels
        data = path.read_bytes()
        word, samples, bits = struct.unpack_from("<3H", data, 2)
        offset = 1024 * word if word < 1024 else word
        scans = (len(data) - offset) // (samples * bits // 8)
        assert with_channels.shape == (scans, 1, samples), path.name
        code, size = {16: ("H", 2), 32: ("i", 4)}[bits]
        for scan in (0, scans // 2, scans - 1):
            values = struct.unpack_from(f"<{samples}{code}", data, offset + scan * samples * size)
            assert [value - _BIAS[bits] for value in values[2:]] == with_channels[scan, 0, 2:].tolist(), path.name


def test_part_of_a_channel_is_no_scan(tmp_path: Path) -> None:
    """The last scan of three channels lacks its last channel: that scan is not whole."""
    stored = np.arange(4 * 3 * 8).reshape(4, 3, 8)
    path = _written(tmp_path / "a.DZT", stored, 16, word=3)
    path.write_bytes(path.read_bytes()[:-16])
    with pytest.raises(InputError, match="traces: expected a whole number, found 3 and a part of one"):
        read_dzt(path)
    profile = read_dzt(path, partial=True)
    np.testing.assert_array_equal(profile.channels[:, :, 2:], stored[:3, :, 2:] - 32768)
    assert profile.cut == "3 of at least 4 traces"


@pytest.mark.parametrize(("place", "form", "value"), [(4, "<H", 9), (6, "<H", 32), (22, "<f", 1.0), (26, "<f", 9.0)])
def test_a_channel_of_another_shape_is_refused(tmp_path: Path, place: int, form: str, value: float) -> None:
    path = _written(tmp_path / "a.DZT", np.zeros((2, 3, 8), int), 16, word=3)
    data = bytearray(path.read_bytes())
    struct.pack_into(form, data, 2048 + place, value)
    path.write_bytes(data)
    with pytest.raises(InputError, match=r"header of channel 2, (samples|bits|position_ns|range_ns): expected"):
        read_dzt(path)
