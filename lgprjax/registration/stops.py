"""Scans that stand for their stretch of travel, and templates made of them."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import body_to_local
from lgprjax.radar import ArrayGeometry, CoefficientBasis, centre_of
from lgprjax.registration.chance import ladder_of
from lgprjax.registration.correlation import Template
from lgprjax.registration.live import LiveScans
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.prepared import PreparedGround

_SPACING = 0.3  # of the wavelength, from stop to stop
_FINE_TRACES = 192  # of a window that the finish takes


class Stops(NamedTuple):
    """Scans that stand for their stretch of travel, in order: history first.

    Attributes:
        number: of the scan in its drive.
        filtered: traces as recorded, track filter applied.
        coefficients, valid: of each trace, at the time scale of that moment.
        pose, speed_mps, sigma_yaw_rad: of the prior.
        reckoned_m: the array's centre by odometry and heading alone.
        path_m: travel.
        leg: number of the stretch over which travel is known.
    """

    number: Int[np.ndarray, " stop"]
    filtered: Float[np.ndarray, "stop channel recorded"]
    coefficients: Float[np.ndarray, "stop channel coefficient"]
    valid: Bool[np.ndarray, "stop channel"]
    pose: Float[np.ndarray, "stop 5"]
    speed_mps: Float[np.ndarray, " stop"]
    sigma_yaw_rad: Float[np.ndarray, " stop"]
    reckoned_m: Float[np.ndarray, "stop 2"]
    path_m: Float[np.ndarray, " stop"]
    leg: Int[np.ndarray, " stop"]


@dataclass(frozen=True)
class Plan:
    """Sizes of a search on a map.

    Attributes:
        spacing_m: of travel from stop to stop.
        lattice_m: step of the lattice of prior errors, forward and left.
        windows_m: lengths tried.
        history: stops that the longest window reaches back.
        members: scans of a window that the finish takes.
    """

    spacing_m: float
    lattice_m: Float[np.ndarray, "2"]
    windows_m: tuple[float, ...]
    history: int
    members: int

    @staticmethod
    def of(prepared: PreparedGround, options: RegisterOptions) -> "Plan":
        """Plan of a search."""
        wavelength_m = prepared.ground.description.settings.wavelength_m
        windows_m = ladder_of(wavelength_m) if options.window_m is None else (options.window_m,)
        longest_m = max(windows_m)
        spacing_m = _SPACING * wavelength_m if longest_m > 0.0 else 0.0
        history = int(np.ceil(longest_m / spacing_m)) + 2 if longest_m > 0.0 else 0
        channels = len(prepared.array.x_m)
        members = 1 if longest_m <= 0.0 else int(np.clip(_FINE_TRACES // channels, 8, 64))
        return Plan(spacing_m, prepared.step_m, windows_m, history, members)

    def points(self, half_m: float) -> tuple[int, int]:
        """Of a lattice, forward and left, that reaches so far to all sides."""
        forward, left = (2 * int(np.ceil(half_m / step_m)) + 1 for step_m in self.lattice_m)
        return forward, left


def stops_of(
    scans: LiveScans, chosen: Int[np.ndarray, " stop"], array: ArrayGeometry, basis: CoefficientBasis
) -> Stops:
    """Stops of these scans, their coefficients yet to be made."""
    track, valid = scans.track, scans.valid[chosen]
    yaw = track.pose[chosen, 3]
    lever = np.stack(body_to_local(np.zeros(len(yaw)), np.zeros(len(yaw)), yaw, *centre_of(array)), axis=1)
    return Stops(
        scans.number[chosen],
        scans.filtered[chosen],
        np.zeros((*valid.shape, 2 * len(basis.angular_frequency_rad_per_ns)), np.float32),
        valid,
        track.pose[chosen],
        track.speed_mps[chosen],
        track.sigma_yaw_rad[chosen],
        scans.dead_reckoned_m[chosen] + lever,
        scans.path_m[chosen],
        track.leg[chosen],
    )


def templates_of(
    stops: Stops,
    array: ArrayGeometry,
    last: Int[np.ndarray, " end"],
    member: Int[np.ndarray, "end member"],
    fresh: Bool[np.ndarray, "end member"],
) -> Template:
    """Traces of the members about the last scan's centre, in its body frame: odometry and heading place the scans, and
    within a scan each channel stands where the vehicle had come when the switch matrix reached it.

    Args:
        stops: the scans.
        array: of the drive.
        last: scan that each template ends with.
        member: scans of each template, the last one first.
        fresh: members to use.
    """
    centre = centre_of(array)
    yaw = stops.pose[:, 3]
    apart = stops.reckoned_m[member] - stops.reckoned_m[last][:, None]
    body_x = array.x_m - centre[0] + stops.speed_mps[member][..., None] * array.time_offset_s
    body_y = np.broadcast_to(array.y_m - centre[1], body_x.shape)
    own = yaw[member][..., None]
    east = apart[..., 0, None] + np.cos(own) * body_x - np.sin(own) * body_y
    north = apart[..., 1, None] + np.sin(own) * body_x + np.cos(own) * body_y
    cos, sin = np.cos(yaw[last])[:, None, None], np.sin(yaw[last])[:, None, None]
    offset = np.stack([cos * east + sin * north, cos * north - sin * east], axis=-1)
    count, members, channels = east.shape
    valid = stops.valid[member] & fresh[..., None]
    coefficients = np.where(valid[..., None], stops.coefficients[member], 0.0)
    first = np.zeros((count, members, channels), bool)
    first[:, 0] = True
    return Template(
        jnp.asarray(coefficients.reshape(count, members * channels, -1), dtype=jnp.float32),
        jnp.asarray(offset.reshape(count, -1, 2), dtype=jnp.float32),
        jnp.asarray(valid.reshape(count, -1)),
        jnp.asarray(first.reshape(count, -1)),
    )
