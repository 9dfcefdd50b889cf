"""Setup of the control loop, read from the files of a configuration at start."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from lgprjax.autopilot import OnboardSetup, onboard_setup
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, VehicleFile, read_route, read_vehicle
from lgprjax.frames import LocalFrame
from lgprjax.mapping import lay_route, read_source, require_map
from lgprjax.navigation import RoutePath
from lgprjax.recordings import chassis_of, filter_model_of, pedals_of, require_drivable, servo_of
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.vehicle import LookAhead

TICK_S = 0.02
"""Tick of the control loop, s: 50 Hz."""


class LaidRoute(NamedTuple):
    """A route of the configuration, ready to drive, or with its problem.

    Attributes:
        name: name of its file.
        path: path to drive; ``None`` if there is a problem.
        length_m: length of all legs.
        points: x and y of at most 400 points, for the display.
        problem: description in one line; empty without a problem.
    """

    name: str
    path: RoutePath | None
    length_m: float
    points: list[list[float]]
    problem: str


class Loaded(NamedTuple):
    """Contents of the files of a run.

    Attributes:
        vehicle: contents of the vehicle file.
        setup: setup of the compiled step.
        frame: frame of map and routes.
        routes: routes in the order of the configuration; at least one has no problem.
        hashes: hash of every file read, by its name in the configuration.
    """

    vehicle: VehicleFile
    setup: OnboardSetup
    frame: LocalFrame
    routes: list[LaidRoute]
    hashes: dict[str, str]


def load(config: RuntimeConfig) -> Loaded:
    """Read vehicle, map and routes.

    Without a map the frame is that of the first route that can be read. A route that cannot be driven is kept with its
    reason, for the operator; the others are used.

    Raises:
        InputError: the vehicle file or the map cannot be used, or no route can.
    """
    vehicle = read_vehicle(config.path(config.vehicle))
    setup = setup_of_vehicle(config, vehicle)
    frame: LocalFrame | None = None
    if config.map:
        with MapFile.open(config.path(config.map)) as source:
            frame = source.description.frame
    hashes = {name: file_hash(config.path(name)) for name in (config.vehicle, config.map) if name}
    routes: list[LaidRoute] = []
    for name in config.routes:
        route, frame = _laid(config, name, frame, hashes)
        routes.append(route)
    if frame is None or all(route.path is None for route in routes):
        raise InputError(config.file, "routes", "a drivable route", routes[0].problem)
    return Loaded(vehicle, setup, frame, routes, hashes)


def setup_of_vehicle(config: RuntimeConfig, vehicle: VehicleFile) -> OnboardSetup:
    """Models and settings by the vehicle file.

    Raises:
        InputError: a required number is not in it.
    """
    path = config.path(config.vehicle)
    if vehicle.steering_kind == "counter_steer":
        require_drivable(vehicle, path, radar=config.ports.radar is not None)
    chassis, servo = chassis_of(vehicle, path), servo_of(vehicle, path)
    pursuit = vehicle.pursuit
    schedule = (pursuit.short_m, pursuit.long_m, pursuit.slow_mps, pursuit.fast_mps)
    # Lever and clock of the array are measured on the vehicle; at one speed they cannot be distinguished from an
    # offset.
    model = filter_model_of(vehicle, path)._replace(initial_lever_m=jnp.float32(0.02))
    free_m, slow_m, stop_m = config.control.cross_sigmas_m
    if not config.map and float(model.gnss_error_sigma_m) > stop_m:
        expected = f"at most {stop_m:g} m, beyond which GNSS alone does not drive the vehicle (control.cross_sigmas_m)"
        raise InputError(path, "navigation.gnss_error_sigma_m", expected, f"{float(model.gnss_error_sigma_m):g}")
    setup = onboard_setup(
        model=model,
        chassis=chassis,
        pedals=pedals_of(vehicle, path),
        look_ahead=LookAhead(*(jnp.float32(number) for number in schedule if number is not None)),
        front_rate_radps=servo.rate_radps,
        tick_s=TICK_S,
        gnss_period_s=config.sensors.gnss_period_s,
        has_lgpr=bool(config.map),
        risk=config.registration.risk,
        weak_exponent=pursuit.weak_exponent or 0.0,
        least_share=1.0 if pursuit.least_torque_share is None else pursuit.least_torque_share,
        slack_rad=servo.dead_band_rad + 0.5 * servo.backlash_rad,
    )
    limits = {"free_cross_m": free_m, "slow_cross_m": slow_m, "stop_cross_m": stop_m}
    limits["degraded_mps"] = config.control.slow_mps
    health = setup.navigator.health._replace(**{name: jnp.float32(value) for name, value in limits.items()})
    return setup._replace(navigator=setup.navigator._replace(health=health))


def _laid(
    config: RuntimeConfig, name: str, frame: LocalFrame | None, hashes: dict[str, str]
) -> tuple[LaidRoute, LocalFrame | None]:
    """A route in a frame; in its own frame if none is given."""
    file = config.path(name)
    try:
        chosen = read_route(file)
        require_map(chosen, file)
        of_map, own = config.path(config.map).resolve(), chosen.map.resolve()
        if config.map and own.name.endswith(".map.h5") and own != of_map:
            raise InputError(file, "map", f"the map of {config.file.name}, {config.map}", str(chosen.map))
        source = read_source(chosen.map)
        # Checked against this vehicle's smallest radius, whichever it was selected with.
        path = lay_route(chosen._replace(vehicle=config.path(config.vehicle)), source, file=file, frame=frame)
    except InputError as error:
        return LaidRoute(name, None, 0.0, [], str(error)), frame
    hashes[name] = file_hash(file)
    legs = int(path.leg_count)
    length_m = float(path.legs.length_m[:legs].sum())
    return LaidRoute(name, path, length_m, _points(path), ""), source.frame if frame is None else frame


def _points(path: RoutePath) -> list[list[float]]:
    """Places along the route for the display."""
    rows = []
    for leg in range(int(path.leg_count)):
        count = round(float(path.legs.length_m[leg]) / float(path.legs.spacing_m[leg])) + 1
        rows.append(np.asarray(path.legs.rows[leg, 1 : count + 1, :2], np.float64))
    points = np.concatenate(rows)
    few = points[np.unique(np.linspace(0, len(points) - 1, 400).astype(int))]
    return [[round(float(x), 2), round(float(y), 2)] for x, y in few]
