"""One recorded scan -> one calibrated profile -> a few coefficients a trace."""

from lgprjax.radar.array import ArrayGeometry, centre_of, uniform_array
from lgprjax.radar.coefficients import (
    CoefficientBasis,
    air_delay_ns,
    coefficient_basis,
    coherence_gain,
    shift_travel_time,
    to_coefficients,
)
from lgprjax.radar.time_domain import (
    WAVE_SPEED_M_PER_NS,
    ChainSettings,
    apply_operator,
    default_chain,
    profile_operator,
    profile_samples,
)
from lgprjax.radar.track_filter import (
    LiveFilterState,
    init_live_filter,
    run_live_filter,
    zero_phase_filter,
)

__all__ = [
    "WAVE_SPEED_M_PER_NS",
    "ArrayGeometry",
    "ChainSettings",
    "CoefficientBasis",
    "LiveFilterState",
    "air_delay_ns",
    "apply_operator",
    "centre_of",
    "coefficient_basis",
    "coherence_gain",
    "default_chain",
    "init_live_filter",
    "profile_operator",
    "profile_samples",
    "run_live_filter",
    "shift_travel_time",
    "to_coefficients",
    "uniform_array",
    "zero_phase_filter",
]
