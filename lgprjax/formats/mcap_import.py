"""A recording of ROS 2 messages (MCAP) as a drive log, streaming: one pass for navigation, one for the scans."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.errors import InputError
from lgprjax.formats.assumed import assumed_of
from lgprjax.formats.drive_description import DriveDescription, NavigationTrack, OdometryTrack
from lgprjax.formats.drive_writer import DriveWriter
from lgprjax.formats.mcap_heard import (
    McapTopics,
    array_message,
    attitude_topic,
    gather,
    odometry_topic,
    position_topic,
    radar_topic,
    scans_of,
)
from lgprjax.formats.mcap_recording import McapRecording
from lgprjax.formats.mcap_scans import Scan, UniformArray, geometry_of, recording_of_form
from lgprjax.formats.mcap_topics import TopicRows
from lgprjax.formats.mcap_tracks import (
    McapAssumed,
    navigation_track,
    odometry_track,
    tracks_assumed,
    travel_along,
)
from lgprjax.formats.ros_messages import DRIVE_METADATA
from lgprjax.formats.utc import utc_ns, utc_text

_BLOCK_SCANS = 256
# Scans that wait for an earlier one; a file that is less in order than this would have to be held in memory.
_MOST_WAITING = 4096
# Registration asks of navigation and odometry to span the scans but for this.
_SLACK_S = 1.0
# Stamps of sensors that lie farther apart than this, as against the times of recording, are not of one clock.
_SAME_CLOCK_S = 1.0
_SECOND_NS = 1_000_000_000


class ImportedRecording(NamedTuple):
    """What became of a recording: scans in the drive log, and in words what is worth knowing."""

    scans: int
    notes: tuple[str, ...]


def import_mcap(
    path: str | Path,
    *,
    topics: McapTopics | None = None,
    array: UniformArray | None = None,
    assumed: McapAssumed | None = None,
    output: str | Path,
    force: bool = False,
) -> ImportedRecording:
    """Write a recording as a drive log.

    Scans are messages ``RadarScan`` (docs/transfer.md), positions ``NavSatFix``. Headings and rolls are those of an
    ``Imu`` (orientation from east, as REP 103 has it), else of a ``PoseWithCovarianceStamped``, else of the topic that
    is named; without any, the heading follows the path. Travel is that of an ``Odometry``, else of the positions. The
    headers' stamps count. Scans that navigation and odometry do not span but for a second are left out.

    Args:
        path: the recording, whole or cut short.
        topics: to read, where several have the type.
        array: instead of the recording's ``RadarArray``.
        assumed: the antenna's place, and sigmas that the messages do not tell.
        output: the drive log.
        force: replace an output that exists.

    Raises:
        InputError: the file is no recording, a topic that is needed is missing or ambiguous, scans change their form
            on the way, what a message does not tell is not assumed either, or the output cannot be written.
    """
    topics, assumed = topics or McapTopics(), assumed or McapAssumed()
    recording = McapRecording(path)
    heard = gather(recording)
    radar = radar_topic(recording, heard, topics.radar)
    form = heard.forms[radar.topic]
    described = array_message(recording, heard, topics.array)
    position = position_topic(recording, heard, topics.gnss)
    attitude = attitude_topic(recording, heard, topics.heading)
    odometer = odometry_topic(recording, heard, topics.odometry)

    scan_ns, _ = radar.sorted()
    told = recording.metadata.get(DRIVE_METADATA, {})
    t0_ns = _t0_ns(recording.path, told, int(scan_ns[0]))
    odometry = None if odometer is None else odometry_track(recording.path, odometer, t0_ns)
    navigation = navigation_track(recording.path, position, attitude, odometry, t0_ns, assumed)
    odometry = odometry or travel_along(navigation)
    scan_time_s = (scan_ns - t0_ns) / 1e9
    kept = _spanned(recording.path, radar, scan_time_s, navigation, odometry)
    used = list(dict.fromkeys(each for each in (radar, position, attitude, odometer) if each is not None))
    notes = _notes(recording, used, attitude, odometer, outside=len(kept) - int(np.count_nonzero(kept)))
    # An exported drive's messages hold what was assumed when it was imported.
    exported = _provenance_told(told)
    made_up = assumed_of(exported)
    made_up.update((str(name), words) for name, words in tracks_assumed(position, attitude, odometer, assumed).items())
    description = DriveDescription(
        name=told.get("name") or Path(output).name.split(".")[0],
        t0_utc=utc_text(t0_ns),
        array=geometry_of(recording.path, form, described, array),
        recording=recording_of_form(recording.path, form, described),
        navigation=navigation,
        odometry=odometry,
        truth=None,
        vehicle=None,
        provenance={
            "made_by": "lgprjax import mcap",
            "inputs": [{"file": recording.path.name, "sha256": _digest(recording.path)}],
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


def _t0_ns(path: Path, told: Mapping[str, str], first_ns: int) -> int:
    """The exported drive's, or the whole second before the first scan."""
    if "t0_utc" not in told:
        return first_ns // _SECOND_NS * _SECOND_NS
    try:
        return utc_ns(told["t0_utc"])
    except ValueError:
        found = repr(told["t0_utc"][:40])
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
        expected = f"scans while navigation and odometry tell, {begin_s:.2f} to {end_s:.2f} s"
        raise InputError(path, radar.topic, expected, f"{scan_time_s[0]:.2f} to {scan_time_s[-1]:.2f} s")
    return np.asarray(kept)


def _notes(
    recording: McapRecording,
    used: Sequence[TopicRows],
    attitude: TopicRows | None,
    odometer: TopicRows | None,
    *,
    outside: int,
) -> tuple[str, ...]:
    """What a user should know of the recording, one line each."""
    notes = []
    if not recording.whole:
        chunks = f", {recording.damaged_chunks} chunks of messages left out" if recording.damaged_chunks else ""
        notes.append(f"the file ends too early or is damaged{chunks}: what is whole was read")
    for rows in used:
        counts = {
            "unreadable": recording.unreadable[rows.topic],
            "without usable values": rows.left_out,
            "without a stamp": rows.unstamped,
            "of a stamp that another had": rows.repeated,
        }
        told = [f"{count} messages {words}" for words, count in counts.items() if count]
        if told:
            notes.append(f"{rows.topic}: left out {', '.join(told)}")
        if rows.unordered:
            notes.append(f"{rows.topic}: {rows.unordered} stamps are earlier than those before them; sorted")
        if not rows.header_clock:
            notes.append(f"{rows.topic}: headers have no stamps, times of recording were taken")
        apart_s = rows.lag_s() - used[0].lag_s()
        if rows.header_clock == used[0].header_clock and abs(apart_s) > _SAME_CLOCK_S:
            beside = f"{rows.topic}: stamps lie {apart_s:.3g} s before those of {used[0].topic}"
            notes.append(f"{beside}, as against the times of recording: one clock may be wrong")
    if attitude is None:
        notes.append("heading from the path, roll taken as 0: no topic tells them")
    if odometer is None:
        notes.append("travel from the positions: no topic of odometry")
    if outside:
        notes.append(f"left out {outside} scans that navigation and odometry do not span")
    return tuple(notes)


def _write_scans(
    writer: DriveWriter,
    recording: McapRecording,
    radar: TopicRows,
    order: Int[np.ndarray, " scan"],
    time_s: Float[np.ndarray, " scan"],
) -> None:
    """Second pass: scans in the order of their stamps; only those wait in memory that came too early."""
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
            expected = f"scans whose stamps are in order but for {_MOST_WAITING}"
            raise InputError(recording.path, radar.topic, expected, f"more waiting for scan {following}")
    _append(writer, block, time_s)
    if writer.scans != len(order):
        raise InputError(recording.path, radar.topic, f"{len(order)} scans, as before", str(writer.scans))


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
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _provenance_told(told: Mapping[str, str]) -> dict[str, object]:
    """What the drive said of its making when it was exported; empty where nothing can be read."""
    try:
        said = json.loads(told["provenance"])
    except (KeyError, ValueError):
        return {}
    return said if isinstance(said, dict) else {}
