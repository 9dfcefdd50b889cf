"""Where a recorded run went and what its vehicle did, as a drive log has it."""

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.archive.run_signals import RunSignals
from lgprjax.formats import MapFile, NavigationTrack, OdometryTrack
from lgprjax.subsurface import SpatialIndex

# What a run does not tell of its poses: the height is the map's, and nothing measures the roll's error.
_SIGMA_HEIGHT_M, _SIGMA_ROLL_DEG = 0.1, 0.2
_CELL_M, _NEAR_M = 1.0, 16.0
_PLANNED = ("sigma_cross_m", "speed_mps", "wanted_mps", "cross_track_m", "to_go_m", "code", "reaction")


class RunTracks:
    """Tracks of a drive log, in seconds since a moment.

    Args:
        signals: of the run.
        mono_ns: the moment, by the computer's monotonic clock.
        source: the map that was driven on.
        position_sigma_m: of the positions.

    Attributes:
        navigation: where GNSS/INS and odometry had the vehicle.
        odometry: of the drive-by-wire box.
        vehicle: its signals, ``None`` where no tick decided anything.
        plan: what the ticks decided, likewise.
        seconds: from the first to the last record of navigation.
    """

    def __init__(self, signals: RunSignals, mono_ns: int, source: MapFile, position_sigma_m: float) -> None:
        self._signals, self._mono_ns = signals, mono_ns
        self.navigation = self._navigation(source, position_sigma_m)
        self.odometry = OdometryTrack(self.seconds_of(signals.box_ns), signals.travel_m)
        self.vehicle = self._vehicle()
        self.plan = self._plan(source)
        self.seconds = float(self.navigation.time_s[-1] - self.navigation.time_s[0])

    def seconds_of(self, times_ns: np.ndarray) -> Float[np.ndarray, " row"]:
        """Times of the log."""
        return np.asarray(1e-9 * (times_ns - self._mono_ns).astype(np.float64))

    def scans_kept(self) -> Bool[np.ndarray, " scan"]:
        """Scans at whose time both navigation and odometry were there."""
        time_s = self.seconds_of(self._signals.scan_ns)
        first = max(self.navigation.time_s[0], self.odometry.time_s[0])
        last = min(self.navigation.time_s[-1], self.odometry.time_s[-1])
        return np.asarray(self._signals.scan_kept & (time_s >= first) & (time_s <= last))

    def _navigation(self, source: MapFile, position_sigma_m: float) -> NavigationTrack:
        prior, frame = self._signals.prior, source.description.frame
        east, north, yaw = prior["pose"].T.astype(np.float64)
        latitude, longitude, height = frame.to_geodetic(east, north, _ground_up_m(source, east, north))
        sigma_m = np.full(len(prior), position_sigma_m)
        return NavigationTrack(
            time_s=self.seconds_of(self._signals.prior_ns),
            latitude_deg=latitude,
            longitude_deg=longitude,
            height_m=height,
            heading_deg=frame.heading_of_yaw(yaw, longitude),
            roll_deg=np.degrees(prior["roll_rad"]),
            sigma_east_m=sigma_m,
            sigma_north_m=sigma_m,
            sigma_height_m=np.full(len(prior), _SIGMA_HEIGHT_M),
            sigma_heading_deg=np.degrees(np.abs(prior["sigma_yaw_rad"])),
            sigma_roll_deg=np.full(len(prior), _SIGMA_ROLL_DEG),
        )

    def _plan(self, source: MapFile) -> dict[str, np.ndarray] | None:
        plan, frame = self._signals.plan, source.description.frame
        if not len(plan):
            return None
        east, north, yaw = plan["pose"].T.astype(np.float64)
        latitude, longitude, _ = frame.to_geodetic(east, north, np.zeros_like(east))
        return {
            "time_s": self.seconds_of(self._signals.plan_ns),
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "heading_deg": frame.heading_of_yaw(yaw, longitude),
            **{name: plan[name] for name in _PLANNED},
        }

    def _vehicle(self) -> dict[str, np.ndarray] | None:
        """What the box measured, with what was commanded at that time; from the first tick that decided on."""
        known, plan = self._signals, self._signals.plan
        if not len(plan):
            return None
        told = known.box_ns >= known.plan_ns[0]
        at, box = known.box_ns[told], known.box[told]
        if not len(box):
            return None
        held = plan[np.searchsorted(known.plan_ns, at, side="right") - 1]
        return {
            "time_s": self.seconds_of(at),
            "steering_potentiometer_v": box["potentiometer_v"].astype(np.float64),
            "encoder_counts": box["encoder_counts"],
            "supply_v": box["supply_v"].astype(np.float64),
            "wheel_angle_rad": held["front_rad"].astype(np.float64),
            "steering_command_rad": held["command"][:, 0].astype(np.float64),
            "throttle": held["command"][:, 1].astype(np.float64),
            "brake": held["command"][:, 2].astype(np.float64),
            "yaw_rate_radps": np.interp(at, known.prior_ns, known.prior["yaw_rate_radps"]),
            "mode": held["mode"].astype(np.int8),
        }


def _ground_up_m(source: MapFile, east_m: np.ndarray, north_m: np.ndarray) -> Float[np.ndarray, " prior"]:
    """Up coordinate of the map's ground where the vehicle was; beyond the map that of where it was last on it."""
    cells, member = np.unique(
        np.floor(np.stack([east_m, north_m], axis=1) / _CELL_M).astype(np.int64), axis=0, return_inverse=True
    )
    stations = SpatialIndex(source.pose[:, :2], 8.0)
    nearest = [stations.nearest((cell + 0.5) * _CELL_M, _NEAR_M) for cell in cells]
    up = np.array([np.nan if station is None else source.ground_up_m[station] for station in nearest])[member.ravel()]
    index, known = np.arange(len(up)), np.isfinite(up)
    if not known.any():
        return np.full(len(up), float(np.median(source.ground_up_m)))
    return np.asarray(np.interp(index, index[known], up[known]))
