"""What a drive log says beside its radar data: where, when, with which array and which recording."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from lgprjax.radar.array import ArrayGeometry
from lgprjax.radar.channels import ChannelResponse


@dataclass(frozen=True)
class NavigationTrack:
    """Poses of the body origin (rear axle), WGS-84. A sigma that nobody stated is ``None``, as those of a true track.

    Attributes:
        time_s: seconds since the drive's ``t0_utc``, strictly increasing.
        latitude_deg, longitude_deg: position.
        height_m: ellipsoidal height of the ground-contact plane at the body origin.
        heading_deg: clockwise from true north.
        roll_deg: positive right side down.
    """

    time_s: Float[np.ndarray, " navigation"]
    latitude_deg: Float[np.ndarray, " navigation"]
    longitude_deg: Float[np.ndarray, " navigation"]
    height_m: Float[np.ndarray, " navigation"]
    heading_deg: Float[np.ndarray, " navigation"]
    roll_deg: Float[np.ndarray, " navigation"]
    sigma_east_m: Float[np.ndarray, " navigation"] | None = None
    sigma_north_m: Float[np.ndarray, " navigation"] | None = None
    sigma_height_m: Float[np.ndarray, " navigation"] | None = None
    sigma_heading_deg: Float[np.ndarray, " navigation"] | None = None
    sigma_roll_deg: Float[np.ndarray, " navigation"] | None = None


@dataclass(frozen=True)
class OdometryTrack:
    """Signed cumulative travel ``distance_m`` (it falls in reverse) at ``time_s`` since the drive's ``t0_utc``."""

    time_s: Float[np.ndarray, " odometry"]
    distance_m: Float[np.ndarray, " odometry"]


@dataclass(frozen=True)
class TraceRecording:
    """How traces were recorded: sample i lies at travel time ``i * sample_interval_ns - time_zero_ns``.

    Attributes:
        sample_interval_ns: two-way travel time between samples.
        time_zero_ns: how long after sample 0 time zero lies.
        zero_level: stored value that stands for no signal (128 for unsigned bytes).
        centre_frequency_hz: nominal centre frequency, ``None`` when unknown.
        samples: samples a trace.
    """

    sample_interval_ns: float
    time_zero_ns: float
    zero_level: float
    centre_frequency_hz: float | None
    samples: int


@dataclass(frozen=True)
class SweepRecording:
    """How stepped-frequency sweeps were recorded, with the look-up sweeps taken in empty space.

    Attributes:
        frequencies_hz: of the steps.
        lookup_sweeps, lookup_calibration_sweep: of every channel and of the calibration channel in empty space.
        group_delay_ns: delay of the calibration channel's path, which dividing by it takes off every echo.
        channel_gain, channel_delay_ns: of each channel relative to the array's mean; ``None`` where not measured,
            which stands for gains of 1 and delays of 0.
    """

    frequencies_hz: Float[np.ndarray, " frequency"]
    lookup_sweeps: Complex[np.ndarray, "channel frequency"]
    lookup_calibration_sweep: Complex[np.ndarray, " frequency"]
    group_delay_ns: float = 0.0
    channel_gain: Float[np.ndarray, " channel"] | None = None
    channel_delay_ns: Float[np.ndarray, " channel"] | None = None

    @property
    def response(self) -> ChannelResponse:
        """Gain and delay of each channel, the defaults where they were not measured."""
        channels = len(self.lookup_sweeps)
        return ChannelResponse(
            np.ones(channels) if self.channel_gain is None else self.channel_gain,
            np.zeros(channels) if self.channel_delay_ns is None else self.channel_delay_ns,
        )


@dataclass(frozen=True)
class DriveDescription:
    """Everything of a drive but its radar data.

    Attributes:
        name: name of the drive.
        t0_utc: moment that every ``time_s`` counts from, ISO 8601.
        array: antenna positions in the body frame.
        recording: traces over travel time, or stepped-frequency sweeps.
        navigation: GNSS/INS poses, with the sigmas that the recording states.
        odometry: signed travel.
        truth: true poses (synthetic, or RTK), without sigmas.
        vehicle: signals by name, ``time_s`` among them.
        provenance: which steps, parameters and inputs made the log; must be JSON.
        serial_number: of the vehicle, stored with its signals; ``None`` where nobody told.
        plan: what the autopilot decided, by name, ``time_s`` among them.
    """

    name: str
    t0_utc: str
    array: ArrayGeometry
    recording: TraceRecording | SweepRecording
    navigation: NavigationTrack
    odometry: OdometryTrack
    truth: NavigationTrack | None
    vehicle: dict[str, np.ndarray] | None
    provenance: dict[str, object]
    serial_number: str | None = None
    plan: dict[str, np.ndarray] | None = None
