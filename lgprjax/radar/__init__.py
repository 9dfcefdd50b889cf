"""One recorded scan -> one calibrated profile -> a few coefficients a trace."""

from lgprjax.radar.array import ArrayGeometry, centre_of, uniform_array
from lgprjax.radar.channels import ChannelResponse, estimate_channel_response, find_dead_channels
from lgprjax.radar.coefficients import (
    LIGHT_SPEED_M_PER_NS,
    CoefficientBasis,
    air_delay_ns,
    coefficient_basis,
    coherence_gain,
    cos_sin,
    shift_travel_time,
    to_coefficients,
)
from lgprjax.radar.radargram import Radargram, clear_view
from lgprjax.radar.stepped_frequency import (
    LookUp,
    calibrate_sweeps,
    depth_window_ns,
    stacked,
    sweep_chain,
    sweep_operator,
    sweep_samples,
    sweep_step_hz,
    sweep_window,
    unambiguous_ns,
)
from lgprjax.radar.time_domain import (
    WAVE_SPEED_M_PER_NS,
    ChainSettings,
    apply_operator,
    default_chain,
    profile_operator,
    profile_samples,
)
from lgprjax.radar.time_scale import stretched_operator, trace_operators
from lgprjax.radar.track_filter import (
    LiveFilterState,
    init_live_filter,
    run_live_filter,
    zero_phase_filter,
)

__all__ = [
    "LIGHT_SPEED_M_PER_NS",
    "WAVE_SPEED_M_PER_NS",
    "ArrayGeometry",
    "ChainSettings",
    "ChannelResponse",
    "CoefficientBasis",
    "LiveFilterState",
    "LookUp",
    "Radargram",
    "air_delay_ns",
    "apply_operator",
    "calibrate_sweeps",
    "centre_of",
    "clear_view",
    "coefficient_basis",
    "coherence_gain",
    "cos_sin",
    "default_chain",
    "depth_window_ns",
    "estimate_channel_response",
    "find_dead_channels",
    "init_live_filter",
    "profile_operator",
    "profile_samples",
    "run_live_filter",
    "shift_travel_time",
    "stacked",
    "stretched_operator",
    "sweep_chain",
    "sweep_operator",
    "sweep_samples",
    "sweep_step_hz",
    "sweep_window",
    "to_coefficients",
    "trace_operators",
    "unambiguous_ns",
    "uniform_array",
    "zero_phase_filter",
]
