"""Synthetic ground with a known truth: a road, a radar over it, drives on different days."""

from lgprjax.scene.calibrated_fixes import calibrated_fixes
from lgprjax.scene.day import Conditions, Cover, Day, Skin, Trench, ground_on, usual_conditions
from lgprjax.scene.drive import (
    SimulatedDrive,
    default_array,
    iterate_sweeps,
    iterate_traces,
    render_drive,
    simulate_drive,
)
from lgprjax.scene.fix_errors import FixErrors, FixErrorState, init_fix_errors, step_fix_errors
from lgprjax.scene.ground import Ground, GroundConfig, Layers, make_ground
from lgprjax.scene.hardware import NO_FAULTS, Faults, Response, ScanErrors
from lgprjax.scene.live_faults import SensorFaults, during, no_faults
from lgprjax.scene.live_radar import LiveRadar, LiveScan, Springs, draw_springs
from lgprjax.scene.live_sensors import (
    LiveSensors,
    LiveSensorState,
    Readings,
    init_live_sensors,
    live_sensors,
    read_live_sensors,
)
from lgprjax.scene.manoeuvres import (
    Manoeuvre,
    drive_palm_tree,
    drive_straight,
    drive_turns,
    half_turn_angles,
    step_pedals,
    step_steering,
    turn_standing,
)
from lgprjax.scene.motion import DrivePlan
from lgprjax.scene.objects import Scatterers, Utilities
from lgprjax.scene.plant import Plant, PlantState, Terrain, init_plant, step_plant
from lgprjax.scene.propagation import RadarConfig, make_wavelet
from lgprjax.scene.receiver import ReceiverConfig, record_scans, time_gain
from lgprjax.scene.render import render_traces
from lgprjax.scene.road import Road, RoadConfig, make_road, straight_road
from lgprjax.scene.sensors import NavigationErrors, OdometerTrack, PoseTrack
from lgprjax.scene.skid_plant import SkidPlant, SkidPlantState, default_skid_plant, init_skid_plant, step_skid_plant
from lgprjax.scene.skid_sensors import (
    SkidReadings,
    SkidSensors,
    SkidSensorState,
    default_skid_sensors,
    init_skid_sensors,
    read_skid_sensors,
)
from lgprjax.scene.slices import GroundSlice, slice_ground
from lgprjax.scene.sweeps import StartOfDay, SweepPlan, record_sweeps, start_of_day
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleDrive, drive_manoeuvre, read_vehicle, simulate_vehicle_drive
from lgprjax.scene.vehicle_sensors import DriveTruth, VehicleSensors
from lgprjax.scene.weather import WEATHER

__all__ = [
    "NO_FAULTS",
    "WEATHER",
    "Conditions",
    "Cover",
    "Day",
    "DrivePlan",
    "DriveTruth",
    "Faults",
    "FixErrorState",
    "FixErrors",
    "Ground",
    "GroundConfig",
    "GroundSlice",
    "Layers",
    "LiveRadar",
    "LiveScan",
    "LiveSensorState",
    "LiveSensors",
    "Manoeuvre",
    "NavigationErrors",
    "OdometerTrack",
    "Plant",
    "PlantState",
    "PoseTrack",
    "RadarConfig",
    "Readings",
    "ReceiverConfig",
    "Response",
    "Road",
    "RoadConfig",
    "ScanErrors",
    "Scatterers",
    "SensorFaults",
    "SimulatedDrive",
    "SkidPlant",
    "SkidPlantState",
    "SkidReadings",
    "SkidSensorState",
    "SkidSensors",
    "Skin",
    "Springs",
    "StartOfDay",
    "SweepPlan",
    "Terrain",
    "Trench",
    "TrueVehicle",
    "Utilities",
    "VehicleDrive",
    "VehicleSensors",
    "calibrated_fixes",
    "default_array",
    "default_skid_plant",
    "default_skid_sensors",
    "draw_springs",
    "drive_manoeuvre",
    "drive_palm_tree",
    "drive_straight",
    "drive_turns",
    "during",
    "ground_on",
    "half_turn_angles",
    "init_fix_errors",
    "init_live_sensors",
    "init_plant",
    "init_skid_plant",
    "init_skid_sensors",
    "iterate_sweeps",
    "iterate_traces",
    "live_sensors",
    "make_ground",
    "make_road",
    "make_wavelet",
    "no_faults",
    "read_live_sensors",
    "read_skid_sensors",
    "read_vehicle",
    "record_scans",
    "record_sweeps",
    "render_drive",
    "render_traces",
    "simulate_drive",
    "simulate_vehicle_drive",
    "slice_ground",
    "start_of_day",
    "step_fix_errors",
    "step_pedals",
    "step_plant",
    "step_skid_plant",
    "step_steering",
    "straight_road",
    "time_gain",
    "turn_standing",
    "usual_conditions",
]
