"""Vendor files, drive logs and maps read as what is drawn of them: radargrams, plans, time slices."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats import DriveLog, MapFile, Profile, TraceRecording, found_time_zero, read_profile, read_segy
from lgprjax.formats.profile import check_channel
from lgprjax.formats.surveys import READERS
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.radar import WAVE_SPEED_M_PER_NS, Radargram, centre_of, clear_view
from lgprjax.recordings import poses_of, recording_of
from lgprjax.report.radargram import LinePlan, LineView, MapStations, counted_columns, even_columns, radargram_of

DRIVE, MAP = ".drive.h5", ".map.h5"
_MOST_PANELS = 4
_BLOCK = 512
_MOST_ANTENNAS = 60_000
_SLICES = 5
_QUIET = 0.1
_PLAN_PLACES = 2000
_NEARLY_ALL = 0.98


def view_of_profile(
    path: Path, *, channel: int | None, raw: bool, speed_m_per_ns: float | None, sample_interval_ns: float | None
) -> LineView:
    """A vendor's file. Raises ``InputError``."""
    if path.suffix.lower() not in READERS:
        expected = f"X{DRIVE}, M{MAP}, or a suffix among {', '.join(READERS)}"
        raise InputError(path, "file name", expected, repr(path.name))
    segy = path.suffix.lower() in (".sgy", ".segy")
    if sample_interval_ns is not None and not segy:
        raise InputError(path, "file name", "SEG-Y (the only format with --sample-interval-ns)", repr(path.name))
    profile = (
        read_segy(path, sample_interval_ns=sample_interval_ns)
        if sample_interval_ns is not None
        else read_profile(path, channel=channel)
    )
    count = profile.channels.shape[1]
    shown = _shown(path, count, None)
    header_ns, (zero_ns, zero_from) = profile.time_zero_ns, found_time_zero(profile)
    if not raw:
        profile = replace(profile, time_zero_ns=zero_ns)
    radargrams = tuple(radargram_of(profile, each) for each in shown)
    if channel is not None:
        radargrams = tuple(replace(each, name=f"channel {channel}") for each in radargrams)
    first = radargrams[0]
    placed = profile.spacing_m is not None or profile.positions_m is not None
    why = "The line does not move" if placed else "The file holds no distance"
    notes = [] if first.in_metres else [f"{why}: traces are counted."]
    notes += [f"{note}." for note in profile.notes]
    if len(first.along) < _NEARLY_ALL * len(profile.channels):
        notes.append(f"{len(first.along)} of {len(profile.channels)} traces are drawn.")
    if zero_from != "header" and not raw:
        notes.append(f"Time zero: the {zero_from} of the direct wave, {zero_ns - header_ns:.1f} ns after the header's.")
    return LineView(
        title=_title(path.name, len(profile.channels), first)
        + (_of_channels(shown, count) if channel is None else f"; channel {channel}"),
        radargrams=tuple(map(clear_view, radargrams)) if not raw else radargrams,
        plan=_plan_of_profile(profile),
        wave_speed_m_per_ns=WAVE_SPEED_M_PER_NS if speed_m_per_ns is None else speed_m_per_ns,
        speed_is=_said(speed_m_per_ns),
        notes=tuple(notes),
    )


def view_of_drive(path: Path, *, channel: int | None, raw: bool, speed_m_per_ns: float | None) -> LineView:
    """A drive log. Raises ``InputError``."""
    with DriveLog.open(path) as log:
        shown = _shown(path, log.channels, channel)
        odometry = log.description.odometry
        travel_m = np.interp(log.scan_time_s, odometry.time_s, odometry.distance_m)
        travel_m = travel_m - travel_m[0]
        notes = []
        # A drive that goes farther in reverse than forward is shown along its way in reverse.
        if -travel_m.min() > travel_m.max():
            travel_m = -travel_m
            notes.append("The drive goes farther in reverse than forward: distance increases in reverse.")
        along, chosen = even_columns(travel_m)
        in_metres = len(along) > 1
        if in_metres:
            backwards = int(np.count_nonzero(np.diff(np.maximum.accumulate(travel_m)) <= 0))
            if backwards:
                notes.append(f"{backwards} of {log.scans} scans, at standstill or in the other direction, are skipped.")
            if len(along) < _NEARLY_ALL * (log.scans - backwards):
                notes.append(f"{len(along)} of {log.scans} scans are drawn.")
        else:
            notes.append("The drive does not move: scans are counted.")
            chosen = counted_columns(log.scans)
            along = chosen.astype(np.float64)
        amplitude, time_ns, frequency_hz, steps = _amplitudes(log, chosen, shown)
        plan = _plan_of_drive(log, travel_m, shown)
    radargrams = tuple(
        Radargram(
            name=f"channel {each}",
            amplitude=amplitude[:, number],
            along=along,
            in_metres=in_metres,
            time_ns=time_ns,
            centre_frequency_hz=frequency_hz,
            steps=steps,
        )
        for number, each in enumerate(shown)
    )
    return LineView(
        title=_title(path.name, log.scans, radargrams[0]) + _of_channels(shown, log.channels),
        radargrams=radargrams if raw else tuple(map(clear_view, radargrams)),
        plan=plan,
        wave_speed_m_per_ns=WAVE_SPEED_M_PER_NS if speed_m_per_ns is None else speed_m_per_ns,
        speed_is=_said(speed_m_per_ns),
        notes=tuple(notes),
    )


def stations_of_map(path: Path, travel_time_ns: float | None = None) -> MapStations:
    """A map's stations, with the level of the ground at one two-way travel time, or at five; very many are decimated.

    Raises:
        InputError: the file is no map, or it holds nothing at this travel time.
    """
    with MapFile.open(path) as source:
        known = source.description
        count = len(source.places)
        chosen = np.arange(0, count, -(-count * known.channels // _MOST_ANTENNAS))
        interval_ns = known.settings.sample_interval_ns
        samples = len(known.gain)
        window = max(1, round(known.settings.wavelength_m / WAVE_SPEED_M_PER_NS / interval_ns))
        few = source.read_stations(np.unique(np.linspace(0, count - 1, min(count, _BLOCK)).astype(int)))
        loudness = (
            np.sqrt(np.mean((few.profile * known.gain)[few.valid] ** 2, axis=0)) if few.valid.any() else known.gain
        )
        # Where nothing repeats, a map's gain is zero and nothing can be drawn.
        deepest = 1 + int(np.flatnonzero(loudness >= _QUIET * loudness.max())[-1])
        if travel_time_ns is None:
            time_ns = (np.arange(_SLICES) + 0.5) / _SLICES * deepest * interval_ns
        elif 0.0 < travel_time_ns <= deepest * interval_ns:
            time_ns = np.array([travel_time_ns], dtype=np.float64)
        else:
            expected = f"above 0 and at most {deepest * interval_ns:.3g} ns, beyond which the map holds almost nothing"
            raise ArgumentError("travel_time_ns", expected, f"{travel_time_ns:g}")
        first = np.clip(np.round(time_ns / interval_ns - window / 2).astype(int), 0, max(samples - window, 0))
        places, levels, baselines = [], [], []
        for low in range(0, len(chosen), _BLOCK):
            numbers = chosen[low : low + _BLOCK]
            stations, where = source.read_stations(numbers), source.places.read(numbers)
            power = (stations.profile * known.gain) ** 2
            level = np.stack([np.sqrt(power[..., at : at + window].mean(axis=-1)) for at in first], axis=-1)
            held = stations.valid
            places.append((where.pose[:, None, :2] + stations.antenna_m[..., :2])[held])
            levels.append(level[held])
            baselines.append(np.broadcast_to(where.drive[:, None], held.shape)[held])
        notes = [] if len(chosen) == count else [f"{len(chosen)} of {count} stations are drawn."]
        if deepest < samples:
            notes.append(
                f"From {deepest * interval_ns:.3g} to {samples * interval_ns:.3g} ns the map holds almost nothing."
            )
        if not any(len(each) for each in places):
            raise InputError(path, "/baselines/valid", "a station in use", "none")
        place = np.concatenate(places)
        return MapStations(
            name=path.name.removesuffix(MAP),
            east_m=place[:, 0],
            north_m=place[:, 1],
            baseline=np.concatenate(baselines),
            level=np.concatenate(levels),
            time_ns=time_ns,
            window_ns=window * interval_ns,
            step_m=known.settings.step_m,
            pitch_m=known.channel_pitch_m if known.channels > 1 else 0.0,
            origin=_origin(known.frame),
            notes=tuple(notes),
        )


def _shown(path: Path, count: int, channel: int | None) -> tuple[int, ...]:
    """The requested channel; else all of a few, or the middle one of many."""
    if channel is None:
        return tuple(range(count)) if count <= _MOST_PANELS else (count // 2,)
    check_channel(path, channel, count)
    return (channel,)


def _said(speed_m_per_ns: float | None) -> Literal["assumed", "given"]:
    return "assumed" if speed_m_per_ns is None else "given"


def _title(name: str, traces: int, first: Radargram) -> str:
    parts = [f"{traces} traces"]
    if first.in_metres:
        parts.append(f"{abs(first.along[-1] - first.along[0]):.4g} m")
    if first.centre_frequency_hz is not None:
        parts.append(f"{first.centre_frequency_hz / 1e6:.4g} MHz")
    return f"{name}: {', '.join(parts)}"


def _of_channels(shown: tuple[int, ...], count: int) -> str:
    return f"; channel {shown[0]} of 0 to {count - 1}" if len(shown) < count else ""


def _amplitudes(
    log: DriveLog, chosen: Int[np.ndarray, " column"], shown: tuple[int, ...]
) -> tuple[Float[np.ndarray, "column channel sample"], Float[np.ndarray, " sample"], float | None, tuple[str, ...]]:
    """Chosen scans of some channels, invalid ones as NaN; travel times; frequency; processing already done."""
    recording = log.description.recording
    drive = recording_of(log)
    matrix, steps = None, tuple[str, ...]()
    if isinstance(recording, TraceRecording):
        time_ns = np.arange(recording.samples) * recording.sample_interval_ns - recording.time_zero_ns
        frequency_hz = recording.centre_frequency_hz
    else:
        settings = drive.chain(0.1, None)
        matrix = np.asarray(drive.operator(settings, drive.samples(settings, None)))
        time_ns = np.arange(matrix.shape[1]) * settings.sample_interval_ns
        frequency_hz = 0.5 * float(recording.frequencies_hz[0] + recording.frequencies_hz[-1])
        steps = (*steps, "sweeps calibrated, look-up subtracted, transformed to travel time")
    amplitude = np.full((len(chosen), len(shown), len(time_ns)), np.nan, np.float32)
    for block in drive.blocks(_BLOCK):
        mine = np.flatnonzero((chosen >= block.start) & (chosen < block.start + len(block.recorded)))
        if len(mine):
            at = chosen[mine] - block.start
            traces = block.recorded[at][:, shown]
            held = block.valid[at][:, shown]
            amplitude[mine] = np.where(held[..., None], traces if matrix is None else traces @ matrix, np.nan)
    return amplitude, time_ns, frequency_hz, steps


def _plan_of_drive(log: DriveLog, travel_m: Float[np.ndarray, " scan"], shown: tuple[int, ...]) -> LinePlan:
    known = log.description
    start = known.navigation
    frame = LocalFrame(float(start.latitude_deg[0]), float(start.longitude_deg[0]), float(start.height_m[0]))
    few = np.unique(np.linspace(0, log.scans - 1, min(log.scans, _PLAN_PLACES)).astype(int))
    pose, _ = poses_of(known.navigation, log.scan_time_s[few], frame, known.array)
    x_m, y_m = centre_of(known.array)
    places = [
        body_to_local(pose[:, 0], pose[:, 1], pose[:, 3], float(x - x_m), float(y - y_m))
        for x, y in zip(known.array.x_m, known.array.y_m, strict=True)
    ]
    return LinePlan(
        east_m=np.stack([east for east, _ in places], axis=1),
        north_m=np.stack([north for _, north in places], axis=1),
        distance_m=travel_m[few],
        shown=shown,
        origin=_origin(frame),
    )


def _plan_of_profile(profile: Profile) -> LinePlan | None:
    """Plan for files whose headers hold coordinates."""
    held = profile.coordinates
    if held is None or profile.positions_m is None:
        return None
    if held.kind == "degrees":
        frame = LocalFrame(float(held.y[0]), float(held.x[0]), 0.0)
        east, north, _ = frame.to_local(held.y, held.x, np.zeros(len(held.x)))
        origin = _origin(frame)
    else:
        east, north = held.x - held.x[0], held.y - held.y[0]
        origin = f"the first trace, easting {held.x[0]:.1f}, northing {held.y[0]:.1f} of the file"
    return LinePlan(
        east_m=east[:, None], north_m=north[:, None], distance_m=profile.positions_m, shown=(0,), origin=origin
    )


def _origin(frame: LocalFrame) -> str:
    return f"latitude {frame.latitude_deg:.6f}°, longitude {frame.longitude_deg:.6f}°"


def check_speed(speed_m_per_ns: float | None) -> None:
    """Refuse what no wave in the ground does. Raises ``ArgumentError``."""
    if speed_m_per_ns is not None and not 0.0 < speed_m_per_ns <= 0.3:
        raise ArgumentError(
            "velocity_m_per_ns",
            "metres per nanosecond, above 0 and at most 0.3 (about 0.1 in soil)",
            f"{speed_m_per_ns:g}",
        )
