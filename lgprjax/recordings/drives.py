"""A drive as input of registration: traces or sweeps in the map's units, positions, levels over depth."""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache, lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, MapFile, NavigationTrack, OdometryTrack, SweepRecording, TraceRecording
from lgprjax.formats.survey_track import CHORD_M, path_headings_deg
from lgprjax.formats.travel import Jump, legs_of, mend_travel, scale_by_fixes, silences
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.radar import (
    ArrayGeometry,
    ChainSettings,
    LookUp,
    apply_operator,
    calibrate_sweeps,
    centre_of,
    default_chain,
    depth_window_ns,
    find_dead_channels,
    profile_operator,
    profile_samples,
    stacked,
    stretched_operator,
    sweep_chain,
    sweep_operator,
    sweep_samples,
    sweep_step_hz,
)
from lgprjax.registration import Operators, Track

_OTHER_SENSOR = "a different sensor from the map's, or a wrong sensor description"
_BAND_SHARE = 0.5
"""A recording that covers less than this share of a map's band is refused."""
_HEAD_SCANS = 64
"""Scans used to detect dead channels: the same for every reader of a drive, at any start."""


class RecordedBlock(NamedTuple):
    """Consecutive scans from scan ``start`` on, ready for the matrix of their recording."""

    start: int
    recorded: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]


class TraceDrive:
    """A drive log of traces."""

    kind = "traces"
    steps = ("time zero", "dewow", "band-pass", "decimate")

    def __init__(self, log: DriveLog, recording: TraceRecording) -> None:
        self._log = log
        self._recording = recording

    def chain(self, scan_spacing_m: float, centre_frequency_hz: float | None) -> ChainSettings:
        """Settings for a map that begins with this drive. Raises ``InputError`` without a known frequency."""
        frequency_hz = self._recording.centre_frequency_hz if centre_frequency_hz is None else centre_frequency_hz
        if frequency_hz is None:
            place = "/radar/traces@centre_frequency_hz"
            raise InputError(self._log.path, place, "a frequency, or --centre-frequency-mhz", "none")
        return default_chain(frequency_hz, scan_spacing_m)

    def samples(self, settings: ChainSettings, travel_time_ns: float | None) -> int:
        """Samples of its profile: to the recording's end, or to ``travel_time_ns`` where that is earlier."""
        known = self._recording
        samples = profile_samples(known.samples, known.sample_interval_ns, known.time_zero_ns, settings)
        return samples if travel_time_ns is None else min(samples, _samples_within(travel_time_ns, settings))

    def operator(self, settings: ChainSettings, kept: int, later_ns: float = 0.0) -> Float[Array, "recorded sample"]:
        """Traces to ``kept`` profile samples, with time zero later than stated by ``later_ns``.

        Raises ``InputError`` where the sampling cannot hold the band.
        """
        known = self._recording
        highest_hz = 0.5e9 / known.sample_interval_ns
        if highest_hz < _least_top_hz(settings):
            place = "/radar/traces@sample_interval_ns"
            raise InputError(
                self._log.path,
                place,
                f"at most {0.5e9 / _least_top_hz(settings):.3g} ns for half of the map's band, {_band(settings)}",
                f"{known.sample_interval_ns:.3g} ns, which holds up to {highest_hz / 1e6:.4g} MHz: {_OTHER_SENSOR}",
            )
        return _trace_operator(known.samples, known.sample_interval_ns, known.time_zero_ns + later_ns, settings, kept)

    def blocks(self, scans: int, start: int = 0) -> Iterator[RecordedBlock]:
        """The drive from ``start`` on in blocks of ``scans``, the last one shorter."""
        for low in range(start, self._log.scans, scans):
            yield RecordedBlock(low, *self._log.read_traces(low, min(low + scans, self._log.scans)))


@lru_cache(maxsize=8)
def _trace_operator(
    samples: int, sample_interval_ns: float, time_zero_ns: float, settings: ChainSettings, kept: int
) -> Float[Array, "recorded sample"]:
    """Computed once for all drives of a radar."""
    return profile_operator(samples, sample_interval_ns, time_zero_ns, settings, kept=kept)


class SweepDrive:
    """A drive log of stepped-frequency sweeps: calibrated, look-up subtracted, channels brought to one response."""

    kind = "sweeps"
    steps = (
        "divide by calibration channel",
        "subtract look-up",
        "gain and delay of channels",
        "window",
        "inverse transform",
    )

    def __init__(self, log: DriveLog, recording: SweepRecording) -> None:
        self._log = log
        self._recording = recording
        if sweep_step_hz(recording.frequencies_hz) is None:
            steps_mhz = np.diff(recording.frequencies_hz) / 1e6
            found = f"steps of {steps_mhz.min():.4g} to {steps_mhz.max():.4g} MHz"
            raise InputError(log.path, "/radar/frequencies_hz", "equal steps, or multiples of one step", found)
        if not np.all(recording.lookup_calibration_sweep):
            zeros = f"{np.count_nonzero(recording.lookup_calibration_sweep == 0)} zeros"
            raise InputError(log.path, "/radar/lookup_calibration_sweep", "non-zero values", zeros)

    def chain(self, scan_spacing_m: float, centre_frequency_hz: float | None) -> ChainSettings:
        """Settings for a map that begins with this drive; sweeps define their band, so no frequency is needed."""
        if centre_frequency_hz is not None:
            expected = "no --centre-frequency-mhz: sweeps define their band"
            raise InputError(self._log.path, "/radar/frequencies_hz", expected, f"{centre_frequency_hz / 1e6:g} MHz")
        return sweep_chain(self._recording.frequencies_hz, scan_spacing_m)

    def samples(self, settings: ChainSettings, travel_time_ns: float | None) -> int:
        """Samples of its profile: up to the unambiguous range, at most ``travel_time_ns`` or fifteen periods."""
        limit_ns = depth_window_ns(settings) if travel_time_ns is None else travel_time_ns
        return sweep_samples(self._recording.frequencies_hz, settings, limit_ns)

    def operator(self, settings: ChainSettings, kept: int) -> Float[Array, "recorded sample"]:
        """Stacked sweeps to ``kept`` profile samples. Raises ``InputError`` if they miss most of the band."""
        frequencies_hz = self._recording.frequencies_hz
        step_hz = float(np.diff(frequencies_hz).min())
        within = (frequencies_hz > settings.band_low_hz) & (frequencies_hz < settings.band_high_hz)
        if np.count_nonzero(within) * step_hz < _BAND_SHARE * (settings.band_high_hz - settings.band_low_hz):
            raise InputError(
                self._log.path,
                "/radar/frequencies_hz",
                f"half of the map's band, {_band(settings)}, or more",
                f"{frequencies_hz[0] / 1e6:.4g} to {frequencies_hz[-1] / 1e6:.4g} MHz: {_OTHER_SENSOR}",
            )
        return sweep_operator(frequencies_hz, settings, group_delay_ns=self._recording.group_delay_ns, kept=kept)

    def blocks(self, scans: int, start: int = 0) -> Iterator[RecordedBlock]:
        """The drive from ``start`` on in blocks of ``scans``, the last one shorter; dead channels are invalid."""
        log, known = self._log, self._recording
        sweeps, calibration, _ = log.read_sweeps(0, min(_HEAD_SCANS, log.scans))
        alive = ~find_dead_channels(sweeps, calibration)
        lookup = LookUp(jnp.asarray(known.lookup_sweeps), jnp.asarray(known.lookup_calibration_sweep))
        response = known.response
        for low in range(start, log.scans, scans):
            sweeps, calibration, valid = log.read_sweeps(low, min(low + scans, log.scans))
            pad = [(0, scans - len(sweeps)), (0, 0)]  # one shape is compiled
            ground, usable = calibrate_sweeps(
                jnp.asarray(np.pad(sweeps, [*pad, (0, 0)])),
                jnp.asarray(np.pad(calibration, pad)),
                lookup,
                type(response)(*(jnp.asarray(part, dtype=jnp.float32) for part in response)),
                jnp.asarray(known.frequencies_hz, dtype=jnp.float32),
            )
            kept = slice(0, len(sweeps))
            yield RecordedBlock(low, np.asarray(stacked(ground))[kept], valid & np.asarray(usable)[kept] & alive)


def recording_of(log: DriveLog) -> TraceDrive | SweepDrive:
    """The radar data of a log, traces or sweeps. Raises ``InputError`` for sweeps that cannot be transformed."""
    recording = log.description.recording
    return TraceDrive(log, recording) if isinstance(recording, TraceRecording) else SweepDrive(log, recording)


def _samples_within(travel_time_ns: float, settings: ChainSettings) -> int:
    return max(2, int(travel_time_ns / settings.sample_interval_ns))


def _least_top_hz(settings: ChainSettings) -> float:
    return settings.band_low_hz + _BAND_SHARE * (settings.band_high_hz - settings.band_low_hz)


def _band(settings: ChainSettings) -> str:
    return f"{settings.band_low_hz / 1e6:.4g} to {settings.band_high_hz / 1e6:.4g} MHz"


# The track of a recorded drive: navigation and odometry brought to the scans and to the array's centre.

_SILENT_S = 1.0
_SAME_DEG, _MOST = 0.01, 0.99  # headings derived from the path agree with its chords, except where they were held
_LESS_SURE = 3.0


class DriveTrack(NamedTuple):
    """A drive's track in a local frame.

    Attributes:
        track: prior pose of the array's centre, travel and speed, at every scan.
        ground_up_m: up coordinate of the ground under the vehicle.
        jumps_bridged: jumps of the recorded travel that were removed.
        breaks: number of jumps across which the travel is unknown; legs of the track begin there.
        travel_scale: factor applied to the recorded travel.
    """

    track: Track
    ground_up_m: Float[np.ndarray, " scan"]
    jumps_bridged: int = 0
    breaks: int = 0
    travel_scale: float = 1.0


def poses_of(
    navigation: NavigationTrack, time_s: Float[np.ndarray, " scan"], frame: LocalFrame, array: ArrayGeometry
) -> tuple[Float[np.ndarray, "scan 5"], Float[np.ndarray, " scan"]]:
    """Poses of the array's centre (height above the ground) and the ground's up coordinate at given times."""
    east, north, up = frame.to_local(navigation.latitude_deg, navigation.longitude_deg, navigation.height_m)
    yaw = np.unwrap(frame.yaw_of_heading(navigation.heading_deg, navigation.longitude_deg))
    roll = np.radians(navigation.roll_deg)
    east, north, up, yaw, roll = (
        np.interp(time_s, navigation.time_s, values) for values in (east, north, up, yaw, roll)
    )
    x_m, y_m = body_to_local(east, north, yaw, *centre_of(array))
    return np.stack([x_m, y_m, np.full_like(x_m, array.height_m), yaw, roll], axis=1), up


def track_of_drive(log: DriveLog, frame: LocalFrame) -> DriveTrack:
    """Track of a drive log in a map's frame; false travel, as where positions jump, is removed.

    Where the odometer is silent, and beyond its first and last record, travel is unknown: such scans are on other legs.

    Raises:
        InputError: navigation or odometry does not span the scans (more than a second is missing).
    """
    description = log.description
    time_s = log.scan_time_s
    for place, covered in (
        ("/gnss_ins/time_s", description.navigation.time_s),
        ("/odometry/time_s", description.odometry.time_s),
    ):
        if covered[0] > time_s[0] + 1.0 or covered[-1] < time_s[-1] - 1.0:
            raise InputError(
                log.path,
                place,
                f"times that span the scans, {time_s[0]:.2f} to {time_s[-1]:.2f} s",
                f"{covered[0]:.2f} to {covered[-1]:.2f} s",
            )
    navigation, odometry = description.navigation, description.odometry
    mended = mend_travel(odometry.time_s, odometry.distance_m)
    jumps = (*mended.bridged, *mended.broken)
    pose, up = poses_of(_turned_across(navigation, odometry, jumps), time_s, frame, description.array)
    travel = np.interp(time_s, odometry.time_s, mended.distance_m)
    sigma_deg = navigation.sigma_heading_deg
    sigma = np.full_like(time_s, 1.0) if sigma_deg is None else np.interp(time_s, navigation.time_s, sigma_deg)
    track = Track(
        pose=pose,
        travel_m=travel,
        speed_mps=_speed(travel, time_s),
        sigma_yaw_rad=np.radians(sigma),
        sigma_m=_position_sigma(navigation, time_s),
        leg=legs_of(time_s, (*mended.broken, *silences(odometry.time_s, mended.distance_m))),
    )
    return DriveTrack(track, up, len(mended.bridged), len(mended.broken))


def travel_scale(
    track: Track, array: ArrayGeometry, pose: Float[np.ndarray, "scan 5"], ok: Bool[np.ndarray, " scan"]
) -> float | None:
    """``scale_by_fixes`` for the rear axle, to which the travel refers.

    Args:
        track: track of the drive.
        array: array whose centre the fixes place.
        pose, ok: poses of the fixes, and mask of accepted ones.
    """
    yaw = np.asarray(track.pose[:, 3], np.float64)
    lever = np.stack(body_to_local(np.zeros(len(yaw)), np.zeros(len(yaw)), yaw, *centre_of(array)), axis=1)
    axle_m, travel_m = np.asarray(pose[:, :2], np.float64) - lever, np.asarray(track.travel_m, np.float64)
    return scale_by_fixes(axle_m, np.unwrap(yaw), travel_m, np.asarray(track.leg), ok)


def scaled_travel(drive: DriveTrack, scale: float) -> DriveTrack:
    """The track of an odometer that counts ``1 / scale`` of a metre for each."""
    track = drive.track
    travel_m = track.travel_m[0] + scale * (track.travel_m - track.travel_m[0])
    track = track._replace(travel_m=travel_m, speed_mps=scale * track.speed_mps)
    return drive._replace(track=track, travel_scale=scale * drive.travel_scale)


def travel_line(drive: DriveTrack) -> str | None:
    """One line about what was changed in the recorded travel; None where nothing was."""
    told = []
    if drive.jumps_bridged + drive.breaks:
        told.append(f"travel jumps that no vehicle can drive: {drive.jumps_bridged} bridged at local speed")
        if drive.breaks:
            told[0] += f", {drive.breaks} left open (windows end there)"
    if drive.travel_scale != 1.0:
        way = "less" if drive.travel_scale > 1.0 else "more"
        told.append(
            f"odometry counts {100.0 * abs(1.0 / drive.travel_scale - 1.0):.1f} % {way} than in the map: "
            "the odometry was scaled by the fixes, and the drive searched again"
        )
    return "; ".join(told) or None


def _position_sigma(navigation: NavigationTrack, time_s: Float[np.ndarray, " scan"]) -> Float[np.ndarray, " scan"]:
    """Standard deviation per axis: root mean of the variances of east and north, m; NaN if the log states none."""
    if navigation.sigma_east_m is None or navigation.sigma_north_m is None:
        return np.full(len(time_s), np.nan)
    variance = 0.5 * (navigation.sigma_east_m**2 + navigation.sigma_north_m**2)
    return np.asarray(np.sqrt(np.interp(time_s, navigation.time_s, variance)))


def _turned_across(navigation: NavigationTrack, odometry: OdometryTrack, jumps: tuple[Jump, ...]) -> NavigationTrack:
    """Headings interpolated across jumps, where they were derived from the path that jumps."""
    if not jumps:
        return navigation
    travel = np.interp(navigation.time_s, odometry.time_s, odometry.distance_m)
    try:
        chords = path_headings_deg(navigation.latitude_deg, navigation.longitude_deg, travel)
    except ValueError:
        return navigation
    off_deg = np.abs((chords - navigation.heading_deg + 180.0) % 360.0 - 180.0)
    if np.mean(off_deg < _SAME_DEG) < _MOST:
        return navigation
    path_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(travel)))])
    bad = np.zeros(len(travel), bool)
    for jump in jumps:
        start_m, stop_m = np.interp([jump.start_s, jump.stop_s], navigation.time_s, path_m)
        bad |= (path_m > start_m - 0.5 * CHORD_M) & (path_m < stop_m + 0.5 * CHORD_M)
    if bad.all():
        return navigation
    heading = np.unwrap(navigation.heading_deg[~bad], period=360.0)
    return replace(navigation, heading_deg=np.interp(navigation.time_s, navigation.time_s[~bad], heading))


def scan_spacing_m(track: Track) -> float:
    """Typical distance between scans while the vehicle moves; 0 if it never does."""
    moved = np.abs(np.diff(track.travel_m))
    moving = moved[moved > 1e-4]
    return float(np.median(moving)) if len(moving) else 0.0


def antennas_of(track: Track, array: ArrayGeometry) -> Float[np.ndarray, "scan channel 3"]:
    """East and north of every antenna from the array's centre, and its height above the ground.

    Each channel is where the vehicle was when the switch matrix reached it.
    """
    centre_x, centre_y = centre_of(array)
    x = array.x_m - centre_x + track.speed_mps[:, None] * array.time_offset_s
    y = np.broadcast_to(array.y_m - centre_y, x.shape)
    cos, sin = np.cos(track.pose[:, 3])[:, None], np.sin(track.pose[:, 3])[:, None]
    height = track.pose[:, 2][:, None] + y * np.sin(track.pose[:, 4])[:, None]
    return np.stack([cos * x - sin * y, sin * x + cos * y, height], axis=-1)


def _speed(travel_m: Float[np.ndarray, " scan"], time_s: Float[np.ndarray, " scan"]) -> Float[np.ndarray, " scan"]:
    """Speed over about a tenth of a second: odometry is coarse from scan to scan."""
    half = max(1, int(0.05 / max(float(np.median(np.diff(time_s))), 1e-4)))
    index = np.arange(len(time_s))
    low, high = np.maximum(index - half, 0), np.minimum(index + half, len(time_s) - 1)
    return np.asarray((travel_m[high] - travel_m[low]) / (time_s[high] - time_s[low]))


def gnss_gaps(log: DriveLog) -> Bool[np.ndarray, " scan"]:
    """Scans at which GNSS/INS was silent for a second, or had three times the sigma of its best.

    Its best is the tenth of the drive's scans with the smallest position sigma.
    """
    navigation, time_s = log.description.navigation, log.scan_time_s
    # Before the first record and after the last one there is no interval.
    interval_s = np.diff(navigation.time_s, prepend=navigation.time_s[:1], append=navigation.time_s[-1:])
    gap = interval_s[np.searchsorted(navigation.time_s, time_s)] > _SILENT_S
    if navigation.sigma_east_m is not None and navigation.sigma_north_m is not None:
        sigma_m = np.maximum(navigation.sigma_east_m, navigation.sigma_north_m)
        at_scan = np.interp(time_s, navigation.time_s, sigma_m)
        gap = gap | (at_scan > _LESS_SURE * np.percentile(at_scan, 10.0))
    return np.asarray(gap)


# Levels of a recording over depth, and matching the levels of traces and of sweeps.
#
# Receivers of traces amplify with travel time, by up to 60 dB, and do not record by how much; sweeps are not amplified.
# A map's depth gain equalises the recordings of its own baselines. A drive of the other kind is first given the levels
# over depth of the map's traces; a drive of the same kind is unchanged.

_STRETCHES = 8
_SCANS = 128  # of a stretch
_REACH = 4 * _SCANS  # scans after its first
_STATIONS = 1024
_SMOOTH = 5


class Alignment(NamedTuple):
    """Changes that bring a drive's traces into agreement with the map.

    Attributes:
        sign: polarity, +1 or -1.
        later_ns: delay of time zero relative to the stated value.
        levelled: whether the levels over depth are adjusted to the map's.
        reversed: whether the line ran in the opposite direction.
        chance: probability that foreign ground leads to this result, over all hypotheses tried; 0 if the drive is used
            as stated.
        told: the result in one line; ``None`` without changes.
    """

    sign: int = 1
    later_ns: float = 0.0
    levelled: bool = False
    reversed: bool = False
    chance: float = 0.0
    told: str | None = None


AS_STATED = Alignment()


def depth_level(
    recording: TraceDrive | SweepDrive,
    operator: Float[Array, "recorded sample"],
    track: Track,
    stretch_m: float,
) -> Float[np.ndarray, " sample"]:
    """RMS at each depth of the signal that changes along a drive: over eight stretches, each minus its mean.

    Args:
        recording: recording of the drive.
        operator: matrix from recorded numbers to samples.
        track: track of the drive; stretches are defined by travel, not by time.
        stretch_m: length of a stretch, that of the background removal.
    """
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    power, traces = np.zeros(operator.shape[1]), 0
    for begin_m in np.linspace(0.0, max(path_m[-1] - stretch_m, 0.0), _STRETCHES):
        places_m = begin_m + np.arange(_SCANS) * (stretch_m / _SCANS)
        wanted = np.unique(np.minimum(np.searchsorted(path_m, places_m), len(path_m) - 1))
        first = int(wanted[0])
        # A stretch with slow motion or standstill is cut short.
        wanted = wanted[wanted < first + _REACH]
        block = next(recording.blocks(_REACH, first))
        recorded, valid = block.recorded[wanted - first], block.valid[wanted - first]
        padded = np.pad(recorded, [(0, _SCANS - len(recorded)), (0, 0), (0, 0)])
        profile = np.asarray(apply_operator(jnp.asarray(padded), operator), dtype=np.float64)[: len(recorded)]
        seen = np.maximum(valid.sum(axis=0), 1)[:, None]
        change = np.where(valid[..., None], profile - np.sum(profile * valid[..., None], axis=0) / seen, 0.0)
        power += np.sum(change**2, axis=(0, 1))
        traces += int(valid.sum())
    return np.asarray(np.sqrt(power / max(traces, 1)))


def map_level(source: MapFile) -> Float[np.ndarray, " sample"]:
    """RMS at each depth of a map's stations: as stored before coding, or over a thousand of them."""
    if source.level is not None:
        return source.level.astype(np.float64)
    chosen = np.unique(np.linspace(0, len(source.places) - 1, _STATIONS).astype(int))
    stations = source.read_stations(chosen)
    power = np.sum(np.where(stations.valid[..., None], stations.profile, 0.0).astype(np.float64) ** 2, axis=(0, 1))
    return np.asarray(np.sqrt(power / max(int(stations.valid.sum()), 1)))


def level_ratio(
    wanted: Float[np.ndarray, " sample"], found: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """Factor for each depth, smoothed over five samples; 0 where there is no signal at all."""
    kernel = np.full(min(_SMOOTH, len(found)), 1.0 / min(_SMOOTH, len(found)))
    want, have = (np.sqrt(np.convolve(level**2, kernel, mode="same")) for level in (wanted, found))
    has_signal = found > 0.0
    return np.asarray(np.where(has_signal, want / np.where(has_signal, have, 1.0), 0.0))


def live_operators(source: MapFile, log: DriveLog, track: Track, alignment: Alignment = AS_STATED) -> Operators:
    """Matrices of a live drive for a map: those of its recording, scaled to the map's levels if the kinds differ.

    Args:
        source: map.
        log: log of the live drive.
        track: track of the drive.
        alignment: sign, time zero and levels to adjust to the map's.

    Returns:
        Function from time scale (see ``RegisterOptions``) to matrix. It raises ``InputError`` if the recording cannot
        be used, or covers too little of the map's band.
    """
    recording, settings = recording_of(log), source.description.settings
    kept = len(source.description.gain)

    def profiles(samples: int) -> Float[Array, "recorded sample"]:
        if isinstance(recording, TraceDrive):
            return recording.operator(settings, samples, alignment.later_ns)
        return recording.operator(settings, samples)

    @cache
    def ratio() -> Float[np.ndarray, " sample"] | None:
        # Maps made before sweeps were supported state no kind: they hold traces.
        if not alignment.levelled and recording.kind == source.provenance.get("recording", TraceDrive.kind):
            return None
        plain = profiles(kept)
        return level_ratio(map_level(source), depth_level(recording, plain, track, settings.track_filter_m))

    @cache
    def operator(time_scale: float) -> Float[Array, "recorded sample"]:
        matrix = stretched_operator(
            profiles,
            kept,
            settings.sample_interval_ns,
            scale=time_scale,
            height_m=log.description.array.height_m,
        )
        levels = ratio()
        matrix = matrix if alignment.sign > 0 else -matrix
        return matrix if levels is None else scaled(matrix, levels)

    return operator


def at_levels(
    operator: Float[Array, "recorded sample"],
    wanted: Float[np.ndarray, " sample"],
    found: Float[np.ndarray, " sample"],
) -> Float[Array, "recorded sample"]:
    """An operator whose profiles have the given levels over depth, up to one factor."""
    return scaled(operator, level_ratio(wanted, found))


def scaled(
    operator: Float[Array, "recorded sample"], ratio: Float[np.ndarray, " sample"]
) -> Float[Array, "recorded sample"]:
    """An operator with its samples in these proportions."""
    return operator * jnp.asarray(ratio / max(float(ratio.max()), 1e-30), dtype=jnp.float32)[None, :]
