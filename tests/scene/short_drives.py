"""Drives of a few metres with three channels, of one shape where they can be: few programs to compile."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lgprjax.radar.array import uniform_array
from lgprjax.scene import (
    NO_FAULTS,
    Day,
    DrivePlan,
    Ground,
    GroundConfig,
    RadarConfig,
    ReceiverConfig,
    ReceiverFaults,
    SimulatedDrive,
    make_ground,
    render_drive,
    simulate_drive,
)
from scene.bare_ground import SPOTLESS

ARRAY = uniform_array(3, 0.2, x_m=1.0, height_m=0.3, scan_period_s=1 / 126)
PLAN = DrivePlan(0.0, 4.5)
STILL = DrivePlan(0.0, 4.5, wander_m=0.0, height_sigma_m=0.0, roll_sigma_rad=0.0)
# So few stones that every slice has the same number of rows, whatever the day.
SPARSE = GroundConfig(length_m=10.0, stones_per_m2=3.0, trees_per_100m=0.0)
GROUND = make_ground(1, SPARSE)
EMPTY = make_ground(
    1,
    replace(
        SPARSE, stones_per_m2=0.0, layer_reflectivity=0.0, utilities_per_100m=0.0, utilities_along=0, moisture_rms=0.0
    ),
)
# One gain for all samples: for what is faint and late, and for what is loud.
FLAT_GAIN = ReceiverConfig(gain_limit=1.0, counts_per_field=7e4)
SOFT_GAIN = ReceiverConfig(gain_limit=1.0, counts_per_field=500.0)


def drive_over(
    ground: Ground,
    day: Day = SPOTLESS,
    seed: int = 3,
    *,
    plan: DrivePlan = STILL,
    faults: ReceiverFaults = NO_FAULTS,
    radar: RadarConfig | None = None,
    receiver: ReceiverConfig | None = None,
) -> SimulatedDrive:
    return simulate_drive(ground, plan, day, seed, array=ARRAY, faults=faults, radar=radar, receiver=receiver)


def recorded(drive: SimulatedDrive) -> Float[np.ndarray, "scan channel sample"]:
    """Counts about the zero level."""
    return render_drive(drive).astype(np.float64) - 128
