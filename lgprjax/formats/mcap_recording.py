"""Messages of an MCAP recording in the order of the file, as far as they are whole.

Needs the optional package mcap (``pip install lgprjax[log]``).
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, NamedTuple

from lgprjax.errors import InputError
from lgprjax.formats.ros_layout import Layout, layout_of

_MAGIC = b"\x89MCAP0\r\n"
_LATEST_NS = (1 << 63) - 1


class LoggedMessage(NamedTuple):
    """One message.

    Attributes:
        topic, kind: its topic, and its type as the recording names it.
        log_ns: when it was recorded, Unix time.
        values: by the paths of the members, see ``Layout.decode``.
    """

    topic: str
    kind: str
    log_ns: int
    values: dict[str, Any]


class McapRecording:
    """An MCAP file; ``messages`` goes through it from the beginning, as often as it is asked to.

    A file that a killed recorder left without its end is read as far as it goes; a chunk whose checksum is wrong is
    left out, and where a record's length is wrong, reading goes on at the next chunk that the file's index knows.

    Attributes:
        path: the file.
        kinds: type of each topic met so far.
        metadata: the file's own records of names and texts, by name, of those met so far.
        whole: whether the last pass met nothing damaged and came to the file's end.
        damaged_chunks: chunks left out in the last pass.
        unreadable: messages of each topic left out in the last pass because they do not decode.
        refused: why topics are not read at all.
    """

    def __init__(self, path: str | Path) -> None:
        """Look whether this is an MCAP file.

        Raises:
            InputError: it is none, cannot be read, or the package mcap is missing.
        """
        self.path = Path(path)
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
        self.kinds: dict[str, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.refused: dict[str, str] = {}
        self._layouts: dict[int, Layout | None] = {}
        self._forget()

    def _forget(self) -> None:
        self.whole = True
        self.damaged_chunks = 0
        self.unreadable: Counter[str] = Counter()
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._layouts.clear()

    def messages(self, only: str | None = None) -> Iterator[LoggedMessage]:
        """All messages that decode, of topics whose definitions can be read, or of one topic.

        Raises:
            InputError: the file system fails.
        """
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
        """Records one after the other; from a damaged one on, the chunks that the index knows."""
        stream.seek(0)
        records, begin = self._reader(stream), 0
        while True:
            try:
                record = next(records)
            except StopIteration:
                return
            except OSError:
                raise
            except Exception:  # whatever damaged or missing bytes made the reader stumble over
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

        # No record is longer than the file: a damaged length must not ask for memory.
        reader = StreamReader(stream, skip_magic=skip_magic, emit_chunks=True, record_size_limit=self._size)
        return iter(reader.records)

    def _read_summary(self, stream: IO[bytes]) -> list[int]:
        """Take definitions from the end of the file, where there are any; where its chunks begin."""
        from mcap.reader import SeekingReader

        try:
            summary = SeekingReader(stream, record_size_limit=self._size).get_summary()
        except Exception:  # the end is missing or damaged; where the disk is, going through the file will say so
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

    def _layout(self, channel: Any) -> Layout | None:
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
    """Raise ``InputError``, about a file to read or write, where the package mcap is missing."""
    try:
        import mcap.stream_reader  # noqa: F401
    except ImportError:
        raise InputError(path, "MCAP", "the optional package mcap (pip install lgprjax[log])", "none") from None
