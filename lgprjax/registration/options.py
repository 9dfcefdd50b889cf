"""What a user decides about a registration."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lgprjax.pso import SwarmConfig
from lgprjax.registration.integrity import Thresholds

_UNSTATED_M = 2.5
_LEAST_M, _MOST_M = 2.0, 6.0
_SIGMAS = 4.0


@dataclass(frozen=True)
class RegisterOptions:
    """What a user decides about a registration; nothing needs to be.

    Attributes:
        search_m: half side of the search square about the prior; None to take it from what the log says of its own
            position: four sigma and half a metre, no less than 2 m, since what a receiver states is not where the
            map's labels lie, and 2.5 m where it says nothing. Where no place is found, or the best one lies at the
            rim, a square of twice the side is searched as well.
        window_m: length of the window of scans that is matched as one; 0 for single scans, None for the shortest of
            the ladder that reaches the risk.
        risk: a fix is believed where ground that is not the map's would have passed the search with no higher
            probability, within a piece of 4 m.
        time_scale: how much longer the wave's way in the ground takes today than on the map's day (rain: above 1);
            None to find it along the drive.
        height_m, roll_deg, pitch_deg: half widths of the search in height, roll and pitch (0: no pitch). That in
            heading follows the prior: three sigma, no less than one degree and no more than five.
        odometer_sigma: of the odometer's scale, as a share: what tyres change by with load, wear and pressure.
        own_thresholds: calibrated on one's own drives, in place of the map's chance and the risk.
        swarm: finish by a swarm of this size about each candidate; without it by Gauss-Newton.
        seed: of the swarm.
    """

    search_m: float | None = None
    window_m: float | None = None
    risk: float = 1e-4
    time_scale: float | None = None
    height_m: float = 0.08
    roll_deg: float = 1.5
    pitch_deg: float = 0.0
    odometer_sigma: float = 0.005
    own_thresholds: Thresholds | None = None
    swarm: SwarmConfig | None = None
    seed: int = 0

    def search_half_m(self, sigma_m: Float[np.ndarray, " scan"] | None = None) -> float:
        """Half side of the search square about priors of which these sigmas are known (NaN: unstated)."""
        if self.search_m is not None:
            return self.search_m
        if sigma_m is None or not np.isfinite(sigma_m).all():
            return _UNSTATED_M
        # Steps of half a metre: each is a shape that is compiled.
        wanted_m = _SIGMAS * float(np.max(sigma_m)) + 0.5
        return float(np.clip(np.ceil(2.0 * wanted_m) / 2.0, _LEAST_M, _MOST_M))

    def half_width(self, sigma_yaw_rad: Float[np.ndarray, " scan"], half_m: float) -> Float[np.ndarray, "scan 6"]:
        """Half widths of the search about priors: along, cross, height, yaw, roll, pitch."""
        yaw = np.clip(3.0 * sigma_yaw_rad, np.radians(1.0), np.radians(5.0))
        # A pitch that is not searched keeps a width: it divides.
        pitch_deg = self.pitch_deg or 1.0
        widths = (half_m, half_m, self.height_m, yaw, np.radians(self.roll_deg), np.radians(pitch_deg))
        return np.stack(np.broadcast_arrays(*widths), axis=-1)
