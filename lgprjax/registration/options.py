"""What a user decides about a registration."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lgprjax.pso import SwarmConfig
from lgprjax.registration.integrity import Thresholds, default_thresholds


@dataclass(frozen=True)
class RegisterOptions:
    """What a user decides about a registration.

    Attributes:
        search_m: half side of the search square about the prior.
        window_m: length of the window of scans that is matched as one; 0 for single scans.
        height_m, roll_deg, pitch_deg: half widths of the search in height, roll and pitch (0: no pitch). That in
            heading follows the prior: three sigma, no less than one degree and no more than five.
        time_scale: how much longer the wave's way in the ground takes today than on the map's day (rain: above 1);
            None to find it along the drive.
        odometer_sigma: of the odometer's scale, as a share: what tyres change by with load, wear and pressure.
        own_thresholds: what a fix must reach; without them the defaults for scans or windows.
        swarm: finish by a swarm of this size about each coarse summit; without it by Gauss-Newton.
        seed: of the swarm.
        memory_mb: bound on what a batch's products at all places of a tile may take, in 10⁶ bytes; a wide search goes
            in smaller batches. One template is always tried, and a quarter more than it takes allowed.
        track: search about the last fix, carried on by odometry, in a region that follows the correlation.
        never_wider: such a region is never wider than ``search_m``: the prior is known to be no farther off.
    """

    search_m: float = 1.5
    window_m: float = 0.0
    height_m: float = 0.08
    roll_deg: float = 1.5
    pitch_deg: float = 0.0
    time_scale: float | None = 1.0
    odometer_sigma: float = 0.005
    own_thresholds: Thresholds | None = None
    swarm: SwarmConfig | None = None
    seed: int = 0
    memory_mb: float = 512.0
    track: bool = False
    never_wider: bool = False

    @property
    def thresholds(self) -> Thresholds:
        """What a fix must reach."""
        if self.own_thresholds is not None:
            return self.own_thresholds
        return default_thresholds(self.window_m, self.search_m)

    def half_width(self, sigma_yaw_rad: Float[np.ndarray, " scan"]) -> Float[np.ndarray, "scan 6"]:
        """Half widths of the search about priors: along, cross, height, yaw, roll, pitch."""
        yaw = np.clip(3.0 * sigma_yaw_rad, np.radians(1.0), np.radians(5.0))
        # A pitch that is not searched keeps a width: it divides.
        pitch_deg = self.pitch_deg or 1.0
        widths = (self.search_m, self.search_m, self.height_m, yaw, np.radians(self.roll_deg), np.radians(pitch_deg))
        return np.stack(np.broadcast_arrays(*widths), axis=-1)
