"""Intact messages of a ROS bag, of ROS 1 (.bag) or of ROS 2 in SQLite (.db3, or its folder), in the order of recording.

Needs the optional package rosbags (``pip install lgprjax[rosbag]``), which reads containers and definitions; messages
are decoded like those of an MCAP recording.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lgprjax.errors import InputError
from lgprjax.formats.mcap_recording import LoggedMessage, McapRecording
from lgprjax.formats.ros import FIX_QUALITY, RADAR_ARRAY, RADAR_SCAN, MessageLayout, definition_of, layout_of

BAG_SUFFIXES = (".bag", ".db3")
_METADATA = "metadata.yaml"


class RosbagRecording:
    """A ROS bag; each call of ``messages`` reads it from the beginning.

    Attributes:
        path: the file, or the folder of a ROS 2 bag.
        kinds: type of each topic.
        metadata: none; as of ``McapRecording``.
        whole: whether the last pass reached the bag's end.
        damaged_chunks: 0; as of ``McapRecording``.
        unreadable: messages of each topic left out in the last pass because they do not decode.
        refused: why topics are not read at all.
    """

    def __init__(self, path: str | Path) -> None:
        """Check that this is a bag.

        Raises:
            InputError: it is not, cannot be read, or the package rosbags is missing.
        """
        self.path = Path(path)
        self._bag = _bag_of(self.path)
        _require_rosbags(self.path)
        self.kinds: dict[str, str] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.refused: dict[str, str] = {}
        self.whole = True
        self.damaged_chunks = 0
        self.unreadable: Counter[str] = Counter()

    def messages(self, only: str | None = None) -> Iterator[LoggedMessage]:
        """All messages that can be decoded, or those of one topic.

        Raises:
            InputError: the bag is damaged from its start on, or the file system fails.
        """
        from rosbags.highlevel import AnyReader

        self.whole, self.unreadable = True, Counter()
        began = False
        try:
            with AnyReader([self._bag], default_typestore=_typestore()) as reader:
                layouts = {each.id: self._layout(reader, each) for each in reader.connections}
                chosen = [
                    each for each in reader.connections if layouts[each.id] is not None and only in (None, each.topic)
                ]
                for connection, log_ns, raw in reader.messages(chosen) if chosen else ():
                    began = True
                    layout = layouts[connection.id]
                    assert layout is not None
                    try:
                        data = raw if reader.is2 else reader.typestore.ros1_to_cdr(raw, connection.msgtype)
                        values = layout.decode(bytes(data))
                    except Exception:  # damaged bytes fail in many ways
                        self.unreadable[connection.topic] += 1
                        continue
                    yield LoggedMessage(connection.topic, connection.msgtype, log_ns, values)
        except OSError as error:
            raise InputError(self.path, "file", "a readable file", error.strerror or str(error)) from None
        except Exception as error:  # any error caused by damaged or missing bytes
            if not began:
                words = " ".join(str(error).split()) or type(error).__name__
                raise InputError(self.path, "file", "a whole ROS bag (rosbag reindex mends a cut one)", words) from None
            self.whole = False

    def _layout(self, reader: Any, connection: Any) -> MessageLayout | None:
        self.kinds[connection.topic] = connection.msgtype
        try:
            definition, _ = reader.typestore.generate_msgdef(connection.msgtype, ros_version=2)
            return layout_of(connection.msgtype, definition)
        except Exception as error:  # an unknown type, or one with features that no reader here needs
            self.refused[connection.topic] = " ".join(str(error).split())
            return None


def is_bag(path: Path) -> bool:
    """Whether a name is that of a bag: a file, or a folder with the metadata of one."""
    return path.suffix.lower() in BAG_SUFFIXES or (path / _METADATA).is_file()


Recording = McapRecording | RosbagRecording


def open_recording(path: str | Path) -> Recording:
    """The recording in a file: a bag by its name, else MCAP. Raises ``InputError`` where it is neither."""
    return RosbagRecording(path) if is_bag(Path(path)) else McapRecording(path)


def _bag_of(path: Path) -> Path:
    """What rosbags opens: a ROS 1 file, or the folder of a ROS 2 bag."""
    if not path.exists():
        raise InputError(path, "file", "a readable file", "No such file or directory")
    if path.suffix.lower() != ".db3":
        return path
    if not (path.parent / _METADATA).is_file():
        raise InputError(path, "bag", f"{_METADATA} beside it, as ros2 bag writes it", "none")
    return path.parent


def _require_rosbags(path: Path) -> None:
    try:
        import rosbags.highlevel  # noqa: F401
    except ImportError:
        raise InputError(
            path, "ROS bag", "the optional package rosbags (pip install lgprjax[rosbag])", "none"
        ) from None


def _typestore() -> Any:
    """The types of ROS 2, and our own: older ROS 2 bags hold no definitions."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.LATEST)
    for kind in (RADAR_SCAN, RADAR_ARRAY, FIX_QUALITY):
        own = definition_of(kind).split("=" * 80)[0]
        store.register(get_types_from_msg(own, kind))
    return store
