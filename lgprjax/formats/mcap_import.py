"""A recording of ROS 2 messages (MCAP) as a drive log, streaming: one pass for navigation, one for the scans."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.errors import InputError
from lgprjax.formats.drive import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack
from lgprjax.formats.mcap_recording import (
    Recording,
    Scan,
    ScanForm,
    UniformArray,
    geometry_of,
    read_scan,
    recording_of_form,
)
from lgprjax.formats.mcap_tracks import (
    COLUMNS,
    McapAssumed,
    TopicRows,
    navigation_track,
    odometry_track,
    tracks_assumed,
    travel_along,
)
from lgprjax.formats.profile import assumed_of
from lgprjax.formats.ros import (
    DRIVE_METADATA,
    IMU,
    NAV_SAT_FIX,
    ODOMETRY,
    POSE,
    RADAR_ARRAY,
    RADAR_SCAN,
    TOPICS,
    is_kind,
)
from lgprjax.formats.rosbag_recording import is_bag, open_recording
from lgprjax.formats.store import utc_ns, utc_text

# Topics of a recording for a drive: one pass through the file, then a choice among them.


class McapTopics(NamedTuple):
    """Topics to read; ``None``: the only one of its type, or the one with the name used by exports."""

    radar: str | None = None
    array: str | None = None
    gnss: str | None = None
    heading: str | None = None
    odometry: str | None = None


class TopicsFound(NamedTuple):
    """Result of a pass through the file, by topic.

    Attributes:
        rows: stamps and numbers of each topic of a known type.
        forms: common form of the scans.
        other: number and form of the first scan that differs.
        arrays: first message of each topic that describes an array.
    """

    rows: dict[str, TopicRows]
    forms: dict[str, ScanForm]
    other: dict[str, tuple[int, ScanForm]]
    arrays: dict[str, Mapping[str, Any]]


def gather(recording: Recording) -> TopicsFound:
    """Read the file once. Raises ``InputError`` if the file system fails."""
    topics_found = TopicsFound({}, {}, {}, {})
    for topic, kind, log_ns, values in recording.messages():
        if is_kind(kind, RADAR_ARRAY):
            topics_found.arrays.setdefault(topic, values)
            continue
        radar = is_kind(kind, RADAR_SCAN)
        columns = 0 if radar else next((n for known, n in COLUMNS.items() if is_kind(kind, known)), None)
        if columns is None:
            continue
        if topic not in topics_found.rows:
            topics_found.rows[topic] = TopicRows(topic, kind, columns)
        rows = topics_found.rows[topic]
        scan = read_scan(values) if radar else None
        if kind != rows.kind or (radar and scan is None):
            rows.left_out += 1
        elif (
            rows.add(values, log_ns)
            and scan is not None
            and scan.form != topics_found.forms.setdefault(topic, scan.form)
        ):
            topics_found.other.setdefault(topic, (len(rows), scan.form))
    return topics_found


def scans_of(recording: Recording, radar: TopicRows) -> Iterator[Scan]:
    """The scans of a topic in file order: one for each row found by ``gather``."""
    again = TopicRows(radar.topic, radar.kind, radar.columns)
    for message in recording.messages(radar.topic):
        scan = read_scan(message.values) if message.kind == radar.kind else None
        if scan is not None and again.add(message.values, message.log_ns):
            yield scan


def radar_topic(recording: Recording, topics_found: TopicsFound, requested: str | None) -> TopicRows:
    """The topic of the scans.

    Raises:
        InputError: there is none, or several without a selection; the topic has fewer than two scans; or their form
            changes.
    """
    radar = choose_topic(recording, topics_found, (RADAR_SCAN,), requested, "scan", "--radar-topic")
    if radar is None:
        raise InputError(recording.path, "topics", f"one of type {RADAR_SCAN}", topics_there(recording))
    if radar.topic in topics_found.other:
        number, form = topics_found.other[radar.topic]
        expected = f"scans like the first, {_words(topics_found.forms[radar.topic])}"
        raise InputError(recording.path, f"{radar.topic}, scan {number}", expected, _words(form))
    if len(radar.order()) < 2:
        raise InputError(recording.path, radar.topic, "at least 2 scans", str(len(radar.order())))
    return radar


def position_topic(recording: Recording, topics_found: TopicsFound, requested: str | None) -> TopicRows:
    """The topic of the positions. Raises ``InputError`` as ``radar_topic`` does."""
    position = choose_topic(recording, topics_found, (NAV_SAT_FIX,), requested, "position", "--gnss-topic")
    if position is None:
        raise InputError(recording.path, "topics", f"one of type {NAV_SAT_FIX} with positions", topics_there(recording))
    return position


def attitude_topic(recording: Recording, topics_found: TopicsFound, requested: str | None) -> TopicRows | None:
    """The topic of headings and rolls; ``None`` without one. A wheel odometer's heading must be selected explicitly.

    Its heading is relative to where it was switched on, which cannot be distinguished from a heading relative to east.

    Raises:
        InputError: the selected topic is unsuitable, or several are suitable.
    """
    if requested is not None:
        return choose_topic(recording, topics_found, (IMU, POSE, ODOMETRY), requested, "attitude", "--heading-topic")
    found = choose_topic(recording, topics_found, (IMU,), None, "attitude", "--heading-topic")
    return found or choose_topic(recording, topics_found, (POSE,), None, "attitude", "--heading-topic")


def odometry_topic(recording: Recording, topics_found: TopicsFound, requested: str | None) -> TopicRows | None:
    """The topic of the odometer; ``None`` without one. Raises ``InputError`` as ``attitude_topic`` does."""
    return choose_topic(recording, topics_found, (ODOMETRY,), requested, "odometry", "--odometry-topic")


def array_message(recording: Recording, topics_found: TopicsFound, requested: str | None) -> Mapping[str, Any] | None:
    """The message that describes the array; ``None`` without one. Raises ``InputError`` as ``attitude_topic``."""
    if requested is not None and requested not in topics_found.arrays:
        raise InputError(recording.path, "--array-topic", f"a topic of type {RADAR_ARRAY}", topics_there(recording))
    preferred = TOPICS["array"][0]
    if requested is None and len(topics_found.arrays) > 1 and preferred not in topics_found.arrays:
        expected = f"one of the topics of type {RADAR_ARRAY}"
        raise InputError(recording.path, "--array-topic", expected, ", ".join(sorted(topics_found.arrays)))
    if requested is None and preferred not in topics_found.arrays:
        return next(iter(topics_found.arrays.values()), None)
    return topics_found.arrays[requested or preferred]


def choose_topic(
    recording: Recording,
    topics_found: TopicsFound,
    kinds: tuple[str, ...],
    requested: str | None,
    default: str,
    option: str,
) -> TopicRows | None:
    """The selected topic of some type, or else the only one, or that with the name ``TOPICS[default]``.

    Raises:
        InputError: the selected topic is missing, of another type or empty; or several are suitable.
    """
    words = " or ".join(kinds)
    found = {
        name: each
        for name, each in topics_found.rows.items()
        if len(each) and any(is_kind(each.kind, k) for k in kinds)
    }
    if requested is not None and requested not in found:
        there = recording.refused.get(requested) or recording.kinds.get(requested)
        reason = topics_there(recording) if there is None else f"{requested}: {there}, nothing usable"
        raise InputError(recording.path, option, f"a topic of type {words}", reason)
    preferred = requested or TOPICS[default][0]
    if len(found) > 1 and preferred not in found:
        raise InputError(recording.path, option, f"one of the topics of type {words}", ", ".join(sorted(found)))
    return found.get(preferred) or next(iter(found.values()), None)


def topics_there(recording: Recording) -> str:
    """Topics of a recording with their types, and why some cannot be read, for messages."""
    texts = {topic: f": {reason}" for topic, reason in recording.refused.items()}
    found = [f"{topic} ({kind}{texts.get(topic, '')})" for topic, kind in sorted(recording.kinds.items())]
    if recording.whole:
        return ", ".join(found) or "no messages"
    cut = f"cut: the file ends too early or is damaged ({recording.repaired_by})"
    return f"{', '.join(found)}; {cut}" if found else f"no whole message; {cut}"


def _words(form: ScanForm) -> str:
    size = f"{form.channels} channels of {form.samples} {form.encoding}"
    return f"{size} every {form.sample_interval_ns:g} ns from {-form.time_zero_ns:g} ns, zero at {form.zero_level:g}"


_BLOCK_SCANS = 256
# Scans that may wait for an earlier one; a file with less order would have to be held in memory.
_MOST_WAITING = 4096
# Registration requires navigation and odometry to span the scans, except for this.
_SLACK_S = 1.0
# Stamps of sensors that differ by more than this, relative to the times of recording, are not of one clock.
_SAME_CLOCK_S = 1.0
_SECOND_NS = 1_000_000_000


class ImportedRecording(NamedTuple):
    """Result of an import: scans in the drive log, and remarks."""

    scans: int
    notes: tuple[str, ...]


def import_mcap(
    path: str | Path,
    *,
    topics: McapTopics | None = None,
    array: UniformArray | None = None,
    assumed: McapAssumed | None = None,
    calibration: str | Path | None = None,
    output: str | Path,
    force: bool = False,
) -> ImportedRecording:
    """Write a recording as a drive log.

    Scans are messages ``RadarScan`` (docs/transfer.md), positions ``NavSatFix``. Headings and rolls are those of an
    ``Imu`` (orientation from east, as REP 103 has it), else of a ``PoseWithCovarianceStamped``, else of the selected
    topic; without any, the heading follows the path. Travel is that of an ``Odometry``, else of the positions. The
    headers' stamps are used. Scans more than a second outside navigation and odometry are left out.

    Args:
        path: path of the recording, complete or truncated.
        topics: topics to read, if several have the type.
        array: array in place of the recording's ``RadarArray``.
        assumed: position of the antenna, and sigmas that the messages do not state.
        calibration: ``X.radar.h5`` of a stepped-frequency radar, in place of the look-up of the ``RadarArray``.
        output: path of the drive log.
        force: whether to replace an existing output.

    Raises:
        InputError: the file is not a recording, a required topic is missing or ambiguous, the form of the scans
            changes, a quantity is neither in the messages nor assumed, or the output cannot be written.
    """
    topics, assumed = topics or McapTopics(), assumed or McapAssumed()
    recording = open_recording(path)
    topics_found = gather(recording)
    radar = radar_topic(recording, topics_found, topics.radar)
    form = topics_found.forms[radar.topic]
    described = array_message(recording, topics_found, topics.array)
    position = position_topic(recording, topics_found, topics.gnss)
    attitude = attitude_topic(recording, topics_found, topics.heading)
    odometer = odometry_topic(recording, topics_found, topics.odometry)

    scan_ns, _ = radar.sorted()
    texts = recording.metadata.get(DRIVE_METADATA, {})
    t0_ns = _t0_ns(recording.path, texts, int(scan_ns[0]))
    odometry = None if odometer is None else odometry_track(recording.path, odometer, t0_ns)
    navigation, judged = navigation_track(recording.path, position, attitude, odometry, t0_ns, assumed)
    travelled = None
    if odometry is None:
        travelled = travel_along(navigation)
        odometry = OdometryTrack(navigation.time_s, travelled.distance_m)
    scan_time_s = (scan_ns - t0_ns) / 1e9
    kept = _spanned(recording.path, radar, scan_time_s, navigation, odometry)
    used = list(dict.fromkeys(each for each in (radar, position, attitude, odometer) if each is not None))
    outside = len(kept) - int(np.count_nonzero(kept))
    notes = (*_notes(recording, used, attitude, odometer, outside=outside), *judged)
    # An exported drive's messages include what was assumed when it was imported.
    exported = _exported_provenance(texts)
    made_up = assumed_of(exported)
    made_up.update((str(name), words) for name, words in tracks_assumed(position, attitude, travelled, assumed).items())
    description = DriveDescription(
        name=texts.get("name") or Path(output).name.split(".")[0],
        t0_utc=utc_text(t0_ns),
        array=geometry_of(recording.path, form, described, array),
        recording=recording_of_form(recording.path, form, described, calibration),
        navigation=navigation,
        odometry=odometry,
        truth=None,
        vehicle=None,
        provenance={
            "made_by": f"lgprjax import {'rosbag' if is_bag(recording.path) else 'mcap'}",
            "inputs": [
                {"file": each.name, "sha256": _digest(each)}
                for each in (recording.path, *([] if calibration is None else [Path(calibration)]))
            ],
            "topics": {each.topic: each.kind for each in used},
            "clocks": {each.topic: "header stamps" if each.header_clock else "times of recording" for each in used},
            "told": assumed._asdict(),
            "assumed": made_up,
            "notes": list(notes),
            "exported": exported,
        },
    )
    with DriveWriter.create(
        output, description, channels=form.channels, dtype=np.dtype(form.encoding), force=force
    ) as writer:
        _write_scans(writer, recording, radar, radar.order()[kept], scan_time_s[kept])
    return ImportedRecording(int(np.count_nonzero(kept)), notes)


def _t0_ns(path: Path, texts: Mapping[str, str], first_ns: int) -> int:
    """The exported drive's, or the whole second before the first scan."""
    if "t0_utc" not in texts:
        return first_ns // _SECOND_NS * _SECOND_NS
    try:
        return utc_ns(texts["t0_utc"])
    except ValueError:
        found = repr(texts["t0_utc"][:40])
        raise InputError(path, f"metadata {DRIVE_METADATA}, t0_utc", "a UTC time in ISO 8601", found) from None


def _spanned(
    path: Path,
    radar: TopicRows,
    scan_time_s: Float[np.ndarray, " scan"],
    navigation: NavigationTrack,
    odometry: OdometryTrack,
) -> Bool[np.ndarray, " scan"]:
    begin_s = max(float(navigation.time_s[0]), float(odometry.time_s[0])) - _SLACK_S
    end_s = min(float(navigation.time_s[-1]), float(odometry.time_s[-1])) + _SLACK_S
    kept = (scan_time_s >= begin_s) & (scan_time_s <= end_s)
    if np.count_nonzero(kept) < 2:
        expected = f"scans covered by navigation and odometry, {begin_s:.2f} to {end_s:.2f} s"
        raise InputError(path, radar.topic, expected, f"{scan_time_s[0]:.2f} to {scan_time_s[-1]:.2f} s")
    return np.asarray(kept)


def _notes(
    recording: Recording,
    used: Sequence[TopicRows],
    attitude: TopicRows | None,
    odometer: TopicRows | None,
    *,
    outside: int,
) -> tuple[str, ...]:
    """Remarks on the recording, one line each."""
    notes = []
    if not recording.whole:
        chunks = f", {recording.damaged_chunks} chunks of messages left out" if recording.damaged_chunks else ""
        notes.append(f"the file ends too early or is damaged{chunks}: the intact part was read")
    for rows in used:
        counts = {
            "unreadable": recording.unreadable[rows.topic],
            "without usable values": rows.left_out,
            "without a stamp": rows.unstamped,
            "of another day than the rest": rows.undated,
            "with a duplicate stamp": rows.repeated,
        }
        texts = [f"{count} messages {words}" for words, count in counts.items() if count]
        if texts:
            notes.append(f"{rows.topic}: left out {', '.join(texts)}")
        if rows.unordered:
            notes.append(f"{rows.topic}: {rows.unordered} stamps are earlier than those before them; sorted")
        if not rows.header_clock:
            notes.append(f"{rows.topic}: headers have no stamps; recording times were used")
        apart_s = rows.lag_s() - used[0].lag_s()
        if rows.header_clock == used[0].header_clock and abs(apart_s) > _SAME_CLOCK_S:
            beside = f"{rows.topic}: stamps are {apart_s:.3g} s before those of {used[0].topic}"
            notes.append(f"{beside}, unlike the recording times: one clock may be wrong")
    if attitude is None:
        notes.append("heading from the path, roll taken as 0: no topic tells them")
    if odometer is None:
        notes.append("travel from positions: no odometry topic")
    if outside:
        notes.append(f"left out {outside} scans outside the time span of navigation and odometry")
    return tuple(notes)


def _write_scans(
    writer: DriveWriter,
    recording: Recording,
    radar: TopicRows,
    order: Int[np.ndarray, " scan"],
    time_s: Float[np.ndarray, " scan"],
) -> None:
    """Second pass: scans in the order of their stamps; only early ones wait in memory."""
    place = np.full(len(radar), -1)
    place[order] = np.arange(len(order))
    waiting: dict[int, Scan] = {}
    block: list[Scan] = []
    for row, scan in enumerate(scans_of(recording, radar)):
        if row >= len(place) or place[row] < 0:
            continue
        waiting[int(place[row])] = scan
        while (following := writer.scans + len(block)) in waiting:
            block.append(waiting.pop(following))
            if len(block) == _BLOCK_SCANS:
                _append(writer, block, time_s)
        if len(waiting) > _MOST_WAITING:
            expected = f"at most {_MOST_WAITING} scans ahead of a late one"
            raise InputError(recording.path, radar.topic, expected, f"more scans before scan {following}")
    _append(writer, block, time_s)
    if writer.scans != len(order):
        raise InputError(recording.path, radar.topic, f"{len(order)} scans, as on the first pass", str(writer.scans))


def _append(writer: DriveWriter, block: list[Scan], time_s: Float[np.ndarray, " scan"]) -> None:
    if not block:
        return
    times = time_s[writer.scans : writer.scans + len(block)]
    signal, valid = np.stack([scan.signal for scan in block]), np.stack([scan.valid for scan in block])
    calibration = [scan.calibration for scan in block if scan.calibration is not None]
    if calibration:
        writer.append_sweeps(times, signal, np.stack(calibration), valid)
    else:
        writer.append(times, signal, valid)
    block.clear()


def _digest(path: Path) -> str:
    if path.is_dir():  # a ROS 2 bag: its files, in the order of their names
        whole = hashlib.sha256()
        for each in sorted(path.iterdir()):
            whole.update(_digest(each).encode() if each.is_file() else b"")
        return whole.hexdigest()
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _exported_provenance(texts: Mapping[str, str]) -> dict[str, object]:
    """Provenance of the drive when it was exported; empty if it cannot be read."""
    try:
        said = json.loads(texts["provenance"])
    except (KeyError, ValueError):
        return {}
    return said if isinstance(said, dict) else {}
