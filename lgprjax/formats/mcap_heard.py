"""What a recording holds for a drive: one pass through the file, then the choice among its topics."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from lgprjax.errors import InputError
from lgprjax.formats.mcap_recording import McapRecording
from lgprjax.formats.mcap_scans import Scan, ScanForm, read_scan
from lgprjax.formats.mcap_topics import COLUMNS, TopicRows
from lgprjax.formats.ros_messages import IMU, NAV_SAT_FIX, ODOMETRY, POSE, RADAR_ARRAY, RADAR_SCAN, TOPICS, is_kind


class McapTopics(NamedTuple):
    """Topics to read; ``None``: the only one of its type, or the one of the name that exports give it."""

    radar: str | None = None
    array: str | None = None
    gnss: str | None = None
    heading: str | None = None
    odometry: str | None = None


class Heard(NamedTuple):
    """What a pass through the file found, by topic.

    Attributes:
        rows: stamps and numbers of each topic of a known type.
        forms: what the scans have in common.
        other: number and form of the first scan that differs.
        arrays: first message of each topic that describes an array.
    """

    rows: dict[str, TopicRows]
    forms: dict[str, ScanForm]
    other: dict[str, tuple[int, ScanForm]]
    arrays: dict[str, Mapping[str, Any]]


def gather(recording: McapRecording) -> Heard:
    """Go through the file once. Raises ``InputError`` where the file system fails."""
    heard = Heard({}, {}, {}, {})
    for topic, kind, log_ns, values in recording.messages():
        if is_kind(kind, RADAR_ARRAY):
            heard.arrays.setdefault(topic, values)
            continue
        radar = is_kind(kind, RADAR_SCAN)
        columns = 0 if radar else next((n for known, n in COLUMNS.items() if is_kind(kind, known)), None)
        if columns is None:
            continue
        if topic not in heard.rows:
            heard.rows[topic] = TopicRows(topic, kind, columns)
        rows = heard.rows[topic]
        scan = read_scan(values) if radar else None
        if kind != rows.kind or (radar and scan is None):
            rows.left_out += 1
        elif rows.add(values, log_ns) and scan is not None and scan.form != heard.forms.setdefault(topic, scan.form):
            heard.other.setdefault(topic, (len(rows), scan.form))
    return heard


def scans_of(recording: McapRecording, radar: TopicRows) -> Iterator[Scan]:
    """The scans of a topic in the order of the file: one for each row that ``gather`` found."""
    again = TopicRows(radar.topic, radar.kind, radar.columns)
    for message in recording.messages(radar.topic):
        scan = read_scan(message.values) if message.kind == radar.kind else None
        if scan is not None and again.add(message.values, message.log_ns):
            yield scan


def radar_topic(recording: McapRecording, heard: Heard, asked: str | None) -> TopicRows:
    """The topic of the scans.

    Raises:
        InputError: there is none, or more than one and none is asked for; it has fewer than two scans; or they change
            their form on the way.
    """
    radar = choose_topic(recording, heard, (RADAR_SCAN,), asked, "scan", "--radar-topic")
    if radar is None:
        raise InputError(recording.path, "topics", f"one of type {RADAR_SCAN}", topics_there(recording))
    if radar.topic in heard.other:
        number, form = heard.other[radar.topic]
        expected = f"scans like the first, {_words(heard.forms[radar.topic])}"
        raise InputError(recording.path, f"{radar.topic}, scan {number}", expected, _words(form))
    if len(radar.order()) < 2:
        raise InputError(recording.path, radar.topic, "at least 2 scans", str(len(radar.order())))
    return radar


def position_topic(recording: McapRecording, heard: Heard, asked: str | None) -> TopicRows:
    """The topic of the positions. Raises ``InputError`` as ``radar_topic`` does."""
    position = choose_topic(recording, heard, (NAV_SAT_FIX,), asked, "position", "--gnss-topic")
    if position is None:
        raise InputError(recording.path, "topics", f"one of type {NAV_SAT_FIX} with positions", topics_there(recording))
    return position


def attitude_topic(recording: McapRecording, heard: Heard, asked: str | None) -> TopicRows | None:
    """The topic of headings and rolls; ``None``: there is none. A wheel odometer's heading must be asked for.

    Its heading counts from where it was switched on, and nothing tells that from one that counts from east.

    Raises:
        InputError: the topic asked for will not do, or several would.
    """
    if asked is not None:
        return choose_topic(recording, heard, (IMU, POSE, ODOMETRY), asked, "attitude", "--heading-topic")
    found = choose_topic(recording, heard, (IMU,), None, "attitude", "--heading-topic")
    return found or choose_topic(recording, heard, (POSE,), None, "attitude", "--heading-topic")


def odometry_topic(recording: McapRecording, heard: Heard, asked: str | None) -> TopicRows | None:
    """The topic of the odometer; ``None``: there is none. Raises ``InputError`` as ``attitude_topic`` does."""
    return choose_topic(recording, heard, (ODOMETRY,), asked, "odometry", "--odometry-topic")


def array_message(recording: McapRecording, heard: Heard, asked: str | None) -> Mapping[str, Any] | None:
    """The message that describes the array; ``None``: there is none. Raises ``InputError`` as ``attitude_topic``."""
    if asked is not None and asked not in heard.arrays:
        raise InputError(recording.path, "--array-topic", f"a topic of type {RADAR_ARRAY}", topics_there(recording))
    preferred = TOPICS["array"][0]
    if asked is None and len(heard.arrays) > 1 and preferred not in heard.arrays:
        expected = f"one of the topics of type {RADAR_ARRAY}"
        raise InputError(recording.path, "--array-topic", expected, ", ".join(sorted(heard.arrays)))
    if asked is None and preferred not in heard.arrays:
        return next(iter(heard.arrays.values()), None)
    return heard.arrays[asked or preferred]


def choose_topic(
    recording: McapRecording, heard: Heard, kinds: tuple[str, ...], asked: str | None, default: str, option: str
) -> TopicRows | None:
    """The topic of some type that is asked for, or else the only one, or that of the name ``TOPICS[default]``.

    Raises:
        InputError: the topic asked for is not there, of another type or holds nothing; or several would do.
    """
    words = " or ".join(kinds)
    found = {name: each for name, each in heard.rows.items() if len(each) and any(is_kind(each.kind, k) for k in kinds)}
    if asked is not None and asked not in found:
        there = recording.refused.get(asked) or recording.kinds.get(asked)
        reason = topics_there(recording) if there is None else f"{asked}: {there}, nothing usable"
        raise InputError(recording.path, option, f"a topic of type {words}", reason)
    preferred = asked or TOPICS[default][0]
    if len(found) > 1 and preferred not in found:
        raise InputError(recording.path, option, f"one of the topics of type {words}", ", ".join(sorted(found)))
    return found.get(preferred) or next(iter(found.values()), None)


def topics_there(recording: McapRecording) -> str:
    """Topics of a recording with their types, and why some are not read, for messages."""
    told = {topic: f": {reason}" for topic, reason in recording.refused.items()}
    found = [f"{topic} ({kind}{told.get(topic, '')})" for topic, kind in sorted(recording.kinds.items())]
    return ", ".join(found) or "no messages"


def _words(form: ScanForm) -> str:
    size = f"{form.channels} channels of {form.samples} {form.encoding}"
    return f"{size} every {form.sample_interval_ns:g} ns from {-form.time_zero_ns:g} ns, zero at {form.zero_level:g}"
