"""Kinds of vehicles: which one a configuration is about, its files, and what it is in the control loop."""

from typing import TypeAlias

from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.counter_steer import CounterSteer
from lgprjax.runtime.control.setup import Loaded, load
from lgprjax.runtime.control.skid.setup import SkidLoaded, load_skid
from lgprjax.runtime.control.skid.vehicle import SkidSteerVehicle
from lgprjax.runtime.control.vehicle_kind import VehicleKind

AnyLoaded: TypeAlias = Loaded | SkidLoaded


def load_vehicle(config: RuntimeConfig) -> AnyLoaded:
    """The files of a configuration: of a field where it has one, else of a course.

    Raises:
        InputError: a file cannot be used.
    """
    return load(config) if config.coverage is None else load_skid(config)


def make_kind(config: RuntimeConfig, loaded: AnyLoaded) -> VehicleKind:
    """The vehicle for a control loop of its own.

    Raises:
        InputError: the vehicle file lacks a number.
    """
    return CounterSteer(config, loaded) if isinstance(loaded, Loaded) else SkidSteerVehicle(config, loaded)
