"""Small generated sites: two baselines, a live drive on another day, an impostor."""

import numpy as np

from lgprjax.scene import Day, DrivePlan, GroundConfig, NavigationErrors, SimulatedDrive, make_ground, simulate_drive

_RTK = NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=np.radians(0.1))


def demo_site(seed: int = 1, length_m: float = 70.0) -> dict[str, SimulatedDrive]:
    """Drives over one road, by name.

    ``baseline_left`` and ``baseline_right`` have a survey-grade GNSS/INS (1 cm, 0.1 deg); ``live`` runs 0.2 m left
    of the middle on another day with GNSS wrong by a metre; ``impostor`` is the same drive over other ground.
    """
    ground = make_ground(seed, GroundConfig(length_m=length_m))
    other = make_ground(seed + 1000, GroundConfig(length_m=length_m))
    baseline_end_m, live_end_m = length_m - 5.0, length_m - 10.0
    biased = NavigationErrors(position_bias_m=(0.8, 0.6))
    live = DrivePlan(5.0, live_end_m, lane_m=0.2)
    return {
        "baseline_left": simulate_drive(
            ground, DrivePlan(0.0, baseline_end_m, lane_m=0.3), Day(seed=10 * seed + 1), 1, errors=_RTK
        ),
        "baseline_right": simulate_drive(
            ground, DrivePlan(0.0, baseline_end_m, lane_m=-0.3), Day(seed=10 * seed + 2), 2, errors=_RTK
        ),
        "live": simulate_drive(ground, live, Day(seed=10 * seed + 3), 3, errors=biased),
        "impostor": simulate_drive(other, live, Day(seed=10 * seed + 4), 3, errors=biased),
    }
