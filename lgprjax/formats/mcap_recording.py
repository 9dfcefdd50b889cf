"""Intact messages of an MCAP recording, in file order.

Needs the optional package mcap (``pip install lgprjax[log]``).
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Num

from lgprjax.errors import InputError
from lgprjax.formats.drive import SweepRecording, TraceRecording
from lgprjax.formats.radar_calibration import SweepLayout, read_radar_calibration
from lgprjax.formats.ros import RADAR_ARRAY, MessageLayout, layout_of
from lgprjax.radar.array import ArrayGeometry, uniform_array

_MAGIC = b"\x89MCAP0\r\n"
_LATEST_NS = (1 << 63) - 1


class LoggedMessage(NamedTuple):
    """One message.

    Attributes:
        topic, kind: topic, and type in the recording.
        log_ns: time of recording, Unix time, ns.
        values: values by the paths of the members, see ``MessageLayout.decode``.
    """

    topic: str
    kind: str
    log_ns: int
    values: dict[str, Any]


class Recording(ABC):
    """A recording of ROS messages; each call of ``messages`` reads it from the beginning.

    Attributes:
        path: the file, or the folder of a ROS 2 bag.
        repaired_by: command that repairs a file that was cut.
        kinds: type of each topic met so far.
        metadata: the file's own records of names and texts, by name, of those met so far.
        whole: whether the last pass found no damage and reached the file's end.
        damaged_chunks: chunks left out in the last pass.
        unreadable: messages of each topic left out in the last pass because they do not decode.
        refused: why topics are not read at all.
    """

    repaired_by: str

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.kinds: dict[str, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.refused: dict[str, str] = {}
        self._forget()

    def _forget(self) -> None:
        """Begin a pass."""
        self.whole = True
        self.damaged_chunks = 0
        self.unreadable: Counter[str] = Counter()

    @abstractmethod
    def messages(self, only: str | None = None) -> Iterator[LoggedMessage]:
        """All messages that can be decoded, or those of one topic. Raises ``InputError`` if the file cannot be read."""


class McapRecording(Recording):
    """An MCAP file.

    A file without an end, from a killed recorder, is read as far as it goes; a chunk with a wrong checksum is left out,
    and after a record with a wrong length reading continues at the next chunk in the file's index.
    """

    def __init__(self, path: str | Path) -> None:
        """Check that this is an MCAP file.

        Raises:
            InputError: the file is not MCAP or cannot be read, or the package mcap is missing.
        """
        super().__init__(path)
        require_mcap(self.path)
        try:
            with self.path.open("rb") as stream:
                begin = stream.read(len(_MAGIC))
                self._size = stream.seek(0, 2)
        except OSError as error:
            raise InputError(self.path, "file", "a readable file", error.strerror or str(error)) from None
        if begin != _MAGIC:
            found = "an empty file" if not begin else "another format"
            raise InputError(self.path, "file", "an MCAP file", found)
        self.repaired_by = f"mcap recover {self.path} -o repaired.mcap"

    def _forget(self) -> None:
        super()._forget()
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._layouts: dict[int, MessageLayout | None] = {}

    def messages(self, only: str | None = None) -> Iterator[LoggedMessage]:
        from mcap.records import Channel, Chunk, Message, Metadata, Schema
        from mcap.stream_reader import breakup_chunk

        self._forget()
        try:
            with self.path.open("rb") as stream:
                index = self._read_summary(stream)
                for record in self._records(stream, index):
                    parts: list[Any] = [record]
                    if isinstance(record, Chunk):
                        try:
                            parts = breakup_chunk(record, validate_crc=True)
                        except Exception:  # damaged bytes make decompression and records fail in many ways
                            self.whole = False
                            self.damaged_chunks += 1
                            continue
                    for part in parts:
                        if isinstance(part, Message):
                            yield from self._decoded(part, only)
                        elif isinstance(part, Channel):
                            self._channels[part.id] = part
                            self._layouts.pop(part.id, None)
                        elif isinstance(part, Schema):
                            self._schemas[part.id] = part
                        elif isinstance(part, Metadata):
                            self.metadata[part.name] = dict(part.metadata)
        except OSError as error:
            raise InputError(self.path, "file", "a readable file", error.strerror or str(error)) from None

    def _records(self, stream: IO[bytes], chunks: list[int]) -> Iterator[Any]:
        """Records in order; after a damaged one, the chunks in the index."""
        stream.seek(0)
        records, begin = self._reader(stream), 0
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except OSError:
                raise
            except Exception:  # any error caused by damaged or missing bytes
                self.whole = False
                break
            begin = stream.tell()
            yield record
        for offset in chunks:
            if offset <= begin:
                continue
            try:
                stream.seek(offset)
                chunk = next(self._reader(stream, skip_magic=True))
            except OSError:
                raise
            except Exception:  # as above: this chunk is damaged as well
                self.damaged_chunks += 1
                continue
            yield chunk

    def _reader(self, stream: IO[bytes], skip_magic: bool = False) -> Iterator[Any]:
        from mcap.stream_reader import StreamReader

        # Records cannot be longer than the file: a damaged length must not allocate memory.
        reader = StreamReader(stream, skip_magic=skip_magic, emit_chunks=True, record_size_limit=self._size)
        return iter(reader.records)

    def _read_summary(self, stream: IO[bytes]) -> list[int]:
        """Read definitions from the end of the file, if there are any; returns the starts of its chunks."""
        from mcap.reader import SeekingReader

        try:
            summary = SeekingReader(stream, record_size_limit=self._size).get_summary()
        except Exception:  # the end is missing or damaged; a disk error will show when the file is read
            return []
        if summary is None:
            return []
        self._schemas |= summary.schemas
        self._channels |= summary.channels
        return sorted(chunk.chunk_start_offset for chunk in summary.chunk_indexes)

    def _decoded(self, message: Any, only: str | None) -> Iterator[LoggedMessage]:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            self.unreadable["a topic that is not defined"] += 1
            return
        if only is not None and channel.topic != only:
            return
        if message.channel_id not in self._layouts:
            self._layouts[message.channel_id] = self._layout(channel)
        layout = self._layouts[message.channel_id]
        if layout is None:
            return
        try:
            values = layout.decode(message.data)
        except ValueError:
            self.unreadable[channel.topic] += 1
            return
        kind = self._schemas[channel.schema_id].name
        yield LoggedMessage(channel.topic, kind, min(message.log_time, _LATEST_NS), values)

    def _layout(self, channel: Any) -> MessageLayout | None:
        schema = self._schemas.get(channel.schema_id)
        self.kinds[channel.topic] = "a type that is not defined" if schema is None else schema.name
        try:
            if schema is None or channel.message_encoding != "cdr" or schema.encoding != "ros2msg":
                encoding = "none" if schema is None else f"{schema.encoding or 'none'}, {channel.message_encoding}"
                raise ValueError(f"expected a ros2msg definition and cdr, found {encoding}")
            return layout_of(schema.name, schema.data.decode())
        except ValueError as error:
            self.refused[channel.topic] = str(error)
            return None


def require_mcap(path: Path) -> None:
    """Raise ``InputError``, about a file to read or write, if the package mcap is missing."""
    try:
        import mcap.stream_reader  # noqa: F401
    except ImportError:
        raise InputError(path, "MCAP", "the optional package mcap (pip install lgprjax[log])", "none") from None


# Scans of a radar array, and the array itself, as messages of a recording.

SWEEPS = "complex64"
ENCODINGS = ("uint8", "int16", "int32", "float32", SWEEPS)


class ScanForm(NamedTuple):
    """Common form of all scans of a recording; see ``RadarScan`` in docs/transfer.md."""

    channels: int
    samples: int
    encoding: str
    sample_interval_ns: float
    time_zero_ns: float
    zero_level: float


class UniformArray(NamedTuple):
    """An array given by the user: evenly spaced channels centred on the vehicle's axis.

    Attributes:
        pitch_m: distance between neighbouring channels; ``None`` for a single one.
        x_m: distance forward of the rear axle.
        height_m: height above the ground.
    """

    pitch_m: float | None = None
    x_m: float = 0.0
    height_m: float = 0.0


class Scan(NamedTuple):
    """One scan: its signal, its valid channels, and for sweeps the calibration channel."""

    form: ScanForm
    signal: Num[np.ndarray, "channel sample"]
    valid: Bool[np.ndarray, " channel"]
    calibration: Complex[np.ndarray, " sample"] | None


def scan_values(
    form: ScanForm,
    signal: Num[np.ndarray, "channel sample"],
    valid: Bool[np.ndarray, " channel"],
    calibration: Complex[np.ndarray, " sample"] | None,
) -> dict[str, Any]:
    """Members of a ``RadarScan`` except its header."""
    return {
        **form._asdict(),
        "valid": valid.astype(np.uint8),
        "data": _bytes_of(signal, form.encoding),
        "calibration": np.zeros(0, np.uint8) if calibration is None else _bytes_of(calibration, form.encoding),
    }


def read_scan(values: Mapping[str, Any]) -> Scan | None:
    """The scan of a ``RadarScan``; ``None`` if sizes do not agree or the encoding is unknown."""
    try:
        return _scan_of(values)
    except (KeyError, ValueError, TypeError, AttributeError):
        return None


def array_values(array: ArrayGeometry, recording: TraceRecording | SweepRecording) -> dict[str, Any]:
    """Members of a ``RadarArray`` except its header."""
    values: dict[str, Any] = {
        "x_m": array.x_m,
        "y_m": array.y_m,
        "time_offset_s": array.time_offset_s,
        "height_m": array.height_m,
        "zero_slip_m": array.zero_slip_m,
    }
    if isinstance(recording, TraceRecording):
        return values | {"centre_frequency_hz": recording.centre_frequency_hz or 0.0}
    return values | {
        "frequencies_hz": recording.frequencies_hz,
        "group_delay_ns": recording.group_delay_ns,
        "lookup_sweeps": recording.lookup_sweeps.astype("<c8").view("<f4"),
        "lookup_calibration_sweep": recording.lookup_calibration_sweep.astype("<c8").view("<f4"),
        "channel_gain": np.zeros(0) if recording.channel_gain is None else recording.channel_gain,
        "channel_delay_ns": np.zeros(0) if recording.channel_delay_ns is None else recording.channel_delay_ns,
    }


def geometry_of(
    path: Path, form: ScanForm, values: Mapping[str, Any] | None, given: UniformArray | None
) -> ArrayGeometry:
    """Geometry of the array as given, or else from a ``RadarArray``; a single channel is on the axis.

    Raises:
        InputError: neither describes this number of channels.
    """
    if given is not None or values is None:
        given = given or UniformArray()
        if given.pitch_m is None and form.channels > 1:
            expected = f"a message of type {RADAR_ARRAY}, or --channel-pitch-m"
            raise InputError(path, "array", expected, f"neither for {form.channels} channels")
        return uniform_array(form.channels, given.pitch_m or 0.0, x_m=given.x_m, height_m=given.height_m)
    lists = {name: _numbers(path, values, name) for name in ("x_m", "y_m", "time_offset_s")}
    for name, numbers in lists.items():
        if len(numbers) != form.channels:
            expected = f"{form.channels} channels as the scans have"
            raise InputError(path, f"RadarArray, {name}", expected, str(len(numbers)))
    # Recordings from before do not have it.
    height_m, zero_slip_m = float(values.get("height_m", np.nan)), float(values.get("zero_slip_m", 0.0))
    return ArrayGeometry(lists["x_m"], lists["y_m"], lists["time_offset_s"], height_m, zero_slip_m)


def recording_of_form(
    path: Path, form: ScanForm, values: Mapping[str, Any] | None, calibration: str | Path | None = None
) -> TraceRecording | SweepRecording:
    """The recording of scans, from their common form and the ``RadarArray``, if there is one.

    Args:
        path: path of the recording.
        form: form of its scans.
        values: values of the ``RadarArray``.
        calibration: ``X.radar.h5``, in place of the look-up of the ``RadarArray``.

    Raises:
        InputError: an interval is invalid; scans are sweeps and the array lacks what is needed to read them; or the
            calibration is not of these sweeps.
    """
    if form.encoding != SWEEPS:
        if calibration is not None:
            raise InputError(path, "RadarScan, encoding", f"{SWEEPS}, sweeps to calibrate", form.encoding)
        if not (np.isfinite(form.sample_interval_ns) and form.sample_interval_ns > 0):
            found = f"{form.sample_interval_ns:g}"
            raise InputError(path, "RadarScan, sample_interval_ns", "a number above zero", found)
        frequency_hz = float((values or {}).get("centre_frequency_hz", 0.0))
        return TraceRecording(
            form.sample_interval_ns, form.time_zero_ns, form.zero_level, frequency_hz or None, form.samples
        )
    layout = layout_of_form(path, form, values)
    assert values is not None
    measured = (_numbers(path, values, name) for name in ("channel_gain", "channel_delay_ns"))
    gain, delay_ns = (numbers if len(numbers) else None for numbers in measured)
    if calibration is not None:
        return read_radar_calibration(calibration, layout, gain=gain, delay_ns=delay_ns)
    lookup, lookup_calibration = (_numbers(path, values, n) for n in ("lookup_sweeps", "lookup_calibration_sweep"))
    due = {
        "lookup_calibration_sweep": (lookup_calibration, 2 * form.samples),
        "lookup_sweeps": (lookup, 2 * form.samples * form.channels),
    }
    for name, (numbers, size) in due.items():
        if len(numbers) != size:
            raise InputError(path, f"RadarArray, {name}", f"{size} numbers, as in the scans", str(len(numbers)))
    return SweepRecording(
        frequencies_hz=layout.frequencies_hz,
        lookup_sweeps=lookup.astype(np.float32).view(np.complex64).reshape(form.channels, form.samples),
        lookup_calibration_sweep=lookup_calibration.astype(np.float32).view(np.complex64),
        group_delay_ns=layout.group_delay_ns,
        channel_gain=gain,
        channel_delay_ns=delay_ns,
    )


def layout_of_form(path: Path, form: ScanForm, values: Mapping[str, Any] | None) -> SweepLayout:
    """Layout of sweeps. Raises ``InputError`` without a ``RadarArray``, or with one of other frequencies."""
    if values is None:
        raise InputError(path, "topics", "a RadarArray for sweeps: frequencies and look-up", "none")
    frequencies_hz = _numbers(path, values, "frequencies_hz")
    if len(frequencies_hz) != form.samples:
        expected = f"{form.samples} numbers, as in the scans"
        raise InputError(path, "RadarArray, frequencies_hz", expected, str(len(frequencies_hz)))
    return SweepLayout(form.channels, frequencies_hz, float(values.get("group_delay_ns", 0.0)))


def _numbers(path: Path, values: Mapping[str, Any], name: str) -> Float[np.ndarray, " number"]:
    numbers = values.get(name)
    if not isinstance(numbers, np.ndarray):
        raise InputError(path, f"RadarArray, {name}", "an array of numbers", "none")
    return numbers.astype(np.float64)


def _bytes_of(signal: np.ndarray, encoding: str) -> np.ndarray:
    little = np.dtype(encoding).newbyteorder("<")
    return np.ascontiguousarray(signal, dtype=little).reshape(-1).view(np.uint8)


def _scan_of(values: Mapping[str, Any]) -> Scan:
    form = ScanForm(**{name: values[name] for name in ScanForm._fields})
    if form.encoding not in ENCODINGS or form.channels < 1 or form.samples < 2:
        raise ValueError("no scan")
    dtype = np.dtype(form.encoding).newbyteorder("<")
    signal = values["data"].view(np.uint8).view(dtype).reshape(form.channels, form.samples)
    valid_values = values["valid"]
    valid = (
        np.ones(form.channels, dtype=bool)
        if not len(valid_values)
        else valid_values.astype(bool).reshape(form.channels)
    )
    calibration = None
    if form.encoding == SWEEPS:
        calibration = values["calibration"].view(np.uint8).view(dtype).reshape(form.samples)
    return Scan(form, signal, valid, calibration)
