"""Tables of a vehicle file that only a skid-steer vehicle with a tool has."""

from lgprjax.formats.vehicle_rules import FileTable


class SkidSteerTable(FileTable):
    """A vehicle that turns by the speeds of its two sides; the body's origin is the midpoint of the track."""

    track_m: float | None = None
    smallest_radius_m: float | None = None
    largest_wheel_mps: float | None = None
    wheel_rate_mps2: float | None = None
    threshold_mps: float | None = None


class ToolTable(FileTable):
    """The rectangle that a tool works, metres, and how deep."""

    width_m: float | None = None
    length_m: float | None = None
    ahead_m: float | None = None
    left_m: float | None = None
    depth_m: float | None = None
    depth_tolerance_m: float | None = None


class CarrotTable(FileTable):
    """The carrot that leads the vehicle along a route, and its PID; gains count by way, not by time."""

    distance_m: float | None = None
    proportional_per_m: float | None = None
    integral_per_m2: float | None = None
    derivative: float | None = None
    largest_curvature_radpm: float | None = None
    slow_mps2: float | None = None
