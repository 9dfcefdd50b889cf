"""ROS bags, of ROS 1 (.bag) or of ROS 2 in SQLite (.db3, or its folder): their intact messages, and bags to write.

Needs the optional package rosbags (``pip install lgprjax[rosbag]``), which reads and writes containers and definitions;
messages are decoded and encoded like those of an MCAP recording.
"""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from lgprjax.errors import InputError
from lgprjax.formats.mcap_recording import LoggedMessage, McapRecording, Recording
from lgprjax.formats.ros import (
    FIX_QUALITY,
    RADAR_ARRAY,
    RADAR_SCAN,
    TRANSFORMS,
    MessageLayout,
    definition_of,
    layout_of,
)
from lgprjax.formats.store import atomic_output

BAG_SUFFIXES = (".bag", ".db3")
_METADATA = "metadata.yaml"


class RosbagRecording(Recording):
    """A ROS bag, without metadata; what is damaged ends a pass."""

    def __init__(self, path: str | Path) -> None:
        """Check that this is a bag.

        Raises:
            InputError: the path is not a bag or cannot be read, or the package rosbags is missing.
        """
        super().__init__(path)
        self._bag = _bag_of(self.path)
        _require_rosbags(self.path)
        ros1 = self._bag.suffix.lower() == ".bag"
        self.repaired_by = f"rosbag reindex {self._bag}" if ros1 else f"ros2 bag reindex {self._bag}"

    def messages(self, only: str | None = None) -> Iterator[LoggedMessage]:
        from rosbags.highlevel import AnyReader

        self._forget()
        began = False
        try:
            with AnyReader([self._bag], default_typestore=_typestore()) as reader:
                types = reader.typestore if reader.is2 else _without_counters(reader.typestore)
                layouts = {each.id: self._layout(types, each) for each in reader.connections}
                chosen = [
                    each for each in reader.connections if layouts[each.id] is not None and only in (None, each.topic)
                ]
                for connection, log_ns, raw in reader.messages(chosen) if chosen else ():
                    began = True
                    layout = layouts[connection.id]
                    assert layout is not None
                    try:
                        data = raw if reader.is2 else types.ros1_to_cdr(raw, connection.msgtype)
                        values = layout.decode(bytes(data))
                    except Exception:  # damaged bytes fail in many ways
                        self.unreadable[connection.topic] += 1
                        continue
                    yield LoggedMessage(connection.topic, connection.msgtype, log_ns, values)
        except OSError as error:
            raise InputError(self.path, "file", "a readable file", error.strerror or str(error)) from None
        except Exception as error:  # any error caused by damaged or missing bytes
            if not began:
                raise InputError(self.path, "file", "a complete ROS bag", self._instead(error)) from None
            self.whole = False

    def _instead(self, error: Exception) -> str:
        """Description of a bag without any readable message, for an error."""
        if self.path.is_file():
            with self.path.open("rb") as stream:
                head = stream.read(16)
            if not head:
                return "an empty file"
            if not head.startswith((b"#ROSBAG", b"SQLite format 3")):
                return "another format"
        words = " ".join(str(error).split()) or type(error).__name__
        return f"a truncated or damaged bag ({words}); {self.repaired_by} repairs some"

    def _layout(self, types: Any, connection: Any) -> MessageLayout | None:
        self.kinds[connection.topic] = connection.msgtype
        try:
            definition, _ = types.generate_msgdef(connection.msgtype, ros_version=2)
            return layout_of(connection.msgtype, definition)
        except Exception as error:  # an unknown type, or one with features that no reader here needs
            self.refused[connection.topic] = " ".join(str(error).split())
            return None


def is_bag(path: Path) -> bool:
    """Whether a name is that of a bag: a file, or a folder with the metadata or the files of one."""
    return path.suffix.lower() in BAG_SUFFIXES or (path / _METADATA).is_file() or any(path.glob("*.db3"))


def open_recording(path: str | Path) -> Recording:
    """The recording in a file: a bag by its name, else MCAP. Raises ``InputError`` where it is neither."""
    return RosbagRecording(path) if is_bag(Path(path)) else McapRecording(path)


def _bag_of(path: Path) -> Path:
    """Path that rosbags opens: a ROS 1 file, or the folder of a ROS 2 bag."""
    if not path.exists():
        raise InputError(path, "file", "a readable file", "No such file or directory")
    if not path.is_dir() and path.suffix.lower() != ".db3":
        return path
    folder = path if path.is_dir() else path.parent
    if not (folder / _METADATA).is_file():
        expected = f"{_METADATA} in the same folder (ros2 bag reindex {folder} writes it)"
        raise InputError(path, "bag", expected, "none")
    return folder


def _require_rosbags(path: Path) -> None:
    try:
        import rosbags.highlevel  # noqa: F401
    except ImportError:
        raise InputError(
            path, "ROS bag", "the optional package rosbags (pip install lgprjax[rosbag])", "none"
        ) from None


def _typestore(*, ros2: bool = True) -> Any:
    """The types of ROS 2 (older bags of it hold no definitions), or of ROS 1, and our own."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST if ros2 else Stores.ROS1_NOETIC)
    # Transforms are missing among those of ROS 1.
    for kind in (RADAR_SCAN, RADAR_ARRAY, FIX_QUALITY, TRANSFORMS):
        own = definition_of(kind).split("=" * 80)[0]
        store.register(get_types_from_msg(own, kind))
    return store


def _without_counters(types: Any) -> Any:
    """The types of a ROS 1 bag with the headers of ROS 2: a conversion skips the counter of those of ROS 1."""
    from rosbags.typesys import Stores, get_typestore

    header = "std_msgs/msg/Header"
    store = get_typestore(Stores.EMPTY)
    store.register({**types.fielddefs, header: get_typestore(Stores.LATEST).fielddefs[header]})
    return store


# Bags to write.


class RosbagWriter:
    """A ROS bag to write; made by ``rosbag_writer``."""

    def __init__(self, writer: Any, ros2: bool) -> None:
        self._writer, self._ros2, self._types = writer, ros2, _typestore()
        # A header of ROS 1 has a counter, which belongs to its definitions and their digests.
        self._definitions = _typestore(ros2=ros2)

    def metadata(self, name: str, texts: dict[str, str]) -> None:
        """Texts about the whole bag. A ROS 1 bag has no place for them."""
        if self._ros2:
            for key, text in texts.items():
                self._writer.set_custom_data(f"{name}.{key}", text)

    def topic(self, topic: str, kind: str, *, latched: bool) -> Any:
        """Begin a topic; subscribers that come late get the last message of a latched one."""
        if not self._ros2:
            return self._writer.add_connection(topic, kind, typestore=self._definitions, latching=int(latched))
        qos = (_latched_qos(),) if latched else ()
        return self._writer.add_connection(topic, kind, typestore=self._definitions, offered_qos_profiles=qos)

    def write(self, topic: Any, ns: int, data: bytes) -> None:
        """Write a message in CDR."""
        self._writer.write(topic, ns, data if self._ros2 else bytes(self._types.cdr_to_ros1(data, topic.msgtype)))


@contextmanager
def rosbag_writer(path: Path, force: bool) -> Iterator[RosbagWriter]:
    """A bag that is complete or absent: ``X.bag`` is a file of ROS 1, ``X.db3`` a folder, as ROS 2 has its bags.

    Raises:
        InputError: the package rosbags is missing, or the output exists (without ``force``) or cannot be written.
    """
    _require_rosbags(path)
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2

    if path.suffix.lower() == ".bag":
        with atomic_output(path, force) as temporary, Writer1(temporary) as one:
            yield RosbagWriter(one, ros2=False)
        return
    # Version 8: ROS 2 Humble and later read it.
    with _atomic_bag(path, force) as temporary, Writer2(temporary, version=8) as two:
        yield RosbagWriter(two, ros2=True)


@contextmanager
def _atomic_bag(path: Path, force: bool) -> Iterator[Path]:
    """``atomic_output`` for the folder of a bag; an existing folder is replaced only if it is a bag."""
    if path.exists() and not force:
        raise InputError(path, "output", "a new folder, or --force", "an existing file or folder")
    if path.exists() and not _is_bag_alone(path):
        expected = f"a new folder, or a folder with only a bag and its {_METADATA} to replace"
        raise InputError(path, "output", expected, "another")
    if not path.parent.is_dir():
        raise InputError(path, "output", "a folder that exists", f"no folder {path.parent}")
    # The file in a bag is named by its folder.
    scratch = path.parent / f".{path.name}.partial-{os.getpid()}"
    try:
        scratch.mkdir()
        yield scratch / path.stem
        _put(scratch / path.stem, path, scratch / "replaced")
    except (OSError, sqlite3.Error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(path, "output", "a folder that can be written", reason) from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _is_bag_alone(folder: Path) -> bool:
    """Whether a folder holds only the files of a bag; other files would be lost with it."""
    if not (folder / _METADATA).is_file():
        return False
    return all(each.name == _METADATA or each.suffix == ".db3" for each in folder.iterdir())


def _put(made: Path, path: Path, aside: Path) -> None:
    """Move a folder to its place; an existing folder is moved aside first, and restored if the move fails."""
    if not path.exists():
        made.replace(path)
        return
    path.replace(aside)
    try:
        made.replace(path)
    except OSError:
        aside.replace(path)
        raise


def _latched_qos() -> Any:
    """Reliable, and kept for late subscribers, as ``/tf_static`` requires."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

    never = QosTime(0, 0)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )
