"""Synthetic ground with a known truth: a corridor, a radar over it, drives on different days."""

from lgprjax.scene.drive import SimulatedDrive, default_array, iterate_traces, render_drive, simulate_drive
from lgprjax.scene.ground import Ground, GroundConfig, GroundSlice, Layers, make_ground, slice_ground
from lgprjax.scene.motion import DrivePlan
from lgprjax.scene.receiver import Day, ReceiverConfig, Response, record_scans, time_gain
from lgprjax.scene.render import RadarConfig, make_wavelet, render_traces
from lgprjax.scene.sensors import NavigationErrors, OdometerTrack, PoseTrack

__all__ = [
    "Day",
    "DrivePlan",
    "Ground",
    "GroundConfig",
    "GroundSlice",
    "Layers",
    "NavigationErrors",
    "OdometerTrack",
    "PoseTrack",
    "RadarConfig",
    "ReceiverConfig",
    "Response",
    "SimulatedDrive",
    "default_array",
    "iterate_traces",
    "make_ground",
    "make_wavelet",
    "record_scans",
    "render_drive",
    "render_traces",
    "simulate_drive",
    "slice_ground",
    "time_gain",
]
