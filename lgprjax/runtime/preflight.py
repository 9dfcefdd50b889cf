"""Checks before a run: files, lines, storage, computer. Nothing is sent."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from lgprjax.errors import InputError
from lgprjax.run_records import Source
from lgprjax.runtime.config import PortTable, RuntimeConfig
from lgprjax.runtime.gnss import GnssParser
from lgprjax.runtime.port import Port

_LISTEN_S = 2.5


class PreflightItem(NamedTuple):
    """One check: name, result, and finding or advice."""

    name: str
    good: bool
    finding: str


def preflight(config: RuntimeConfig) -> Iterator[PreflightItem]:
    """Run all checks in order."""
    if config.mode == "record":
        yield _tried("vehicle file", lambda: check_recordable(config))
    else:
        yield from _files(config) if config.coverage is None else _field_files(config)
    if config.radar.calibration is not None:
        yield _tried("radar calibration", lambda: _calibration(config))
    yield _storage(config)
    yield _display(config)
    yield _cores(config)
    yield from _lines(config)


def _calibration(config: RuntimeConfig) -> str:
    from lgprjax.formats import read_radar_calibration

    assert config.radar.calibration is not None
    known = read_radar_calibration(config.path(config.radar.calibration))
    assert known.channel_valid is not None
    channels = f"{known.channel_valid.sum()} of {len(known.channel_valid)} channels"
    return f"{channels}, {'look-up only' if known.channel_gain is None else 'gain and delay measured'}"


def _files(config: RuntimeConfig) -> Iterator[PreflightItem]:
    from lgprjax.formats import MapFile, read_vehicle
    from lgprjax.runtime.control.setup import load, setup_of_vehicle
    from lgprjax.runtime.control.watches import Watches
    from lgprjax.runtime.registration.search import options_of

    def vehicle() -> str:
        held = read_vehicle(config.path(config.vehicle))
        setup_of_vehicle(config, held)
        Watches(config, held)
        only = "" if held.speed_control else ", steering only: the operator has throttle and brake"
        return f"{held.name}, serial number {held.serial_number or 'unknown'}{only}"

    def database() -> str:
        with MapFile.open(config.path(config.map)) as source:
            return f"{len(source.places)} stations, {source.description.channels} channels"

    def registration() -> str:
        options, own = options_of(config), config.registration.thresholds
        finding = (
            f"{options.search_m:g} m around the prior; a fix is accepted up to a risk of {config.registration.risk:g}"
        )
        return finding + (f", and by {own}" if own is not None else "")

    yield _tried("vehicle file", vehicle)
    if config.map:
        yield _tried("map", database)
        yield _tried("registration", registration)
    elif config.ports.radar is not None:
        yield _tried("recording of the radar", lambda: check_recordable(config))
    try:
        routes = load(config).routes
    except InputError as error:
        yield PreflightItem("routes", False, str(error))
        return
    for route in routes:
        yield PreflightItem(f"route {route.name}", route.path is not None, route.problem or f"{route.length_m:.1f} m")


def check_recordable(config: RuntimeConfig) -> str:
    """Check before a first drive what its drive log needs, while there is time to correct it.

    Returns:
        the place of the array, or of a hand cart its tool, in words.

    Raises:
        InputError: the vehicle file cannot be used, or neither file states place and spacing of the channels.
    """
    from lgprjax.formats import read_vehicle

    if config.coverage is not None:
        from lgprjax.recordings.vehicles import tool_of

        path = config.path(config.vehicle)
        return f"{config.vehicle}, tool {tool_of(read_vehicle(path), path).width_m:g} m wide"
    array = read_vehicle(config.path(config.vehicle)).array if config.vehicle else None
    if config.ports.radar is not None:
        if array is not None and (array.x_m is None or array.height_m is None):
            raise InputError(config.path(config.vehicle), "array", "x_m and height_m", "none")
        if config.radar.channel_pitch_m is None and (array is None or array.channel_y_m is None):
            expected = "the spacing of the channels, or array.channel_y_m in the vehicle file"
            raise InputError(config.file, "radar.channel_pitch_m", expected, "none")
    if array is None or array.x_m is None:
        return "array assumed at the antenna"
    return f"{config.vehicle}, array {array.x_m:g} m ahead of the rear axle"


def _field_files(config: RuntimeConfig) -> Iterator[PreflightItem]:
    from lgprjax.formats import read_vehicle
    from lgprjax.runtime.control.skid.setup import load_skid

    def vehicle() -> str:
        held = read_vehicle(config.path(config.vehicle))
        return f"{held.name}, serial number {held.serial_number or 'unknown'}"

    def plan() -> str:
        loaded = load_skid(config)
        if loaded.name is None:
            return "none: what is worked by remote control is recorded, but the vehicle does not drive"
        found = f"{loaded.name}, {loaded.lines} lines, {float(loaded.route.length_m):.0f} m"
        return found + (", in part in reverse" if loaded.route.legs is not None else "")

    yield _tried("vehicle file", vehicle)
    yield _tried("plan", plan)


def _storage(config: RuntimeConfig) -> PreflightItem:
    folder = config.path(config.recording.folder)
    there = next(each for each in (folder, *folder.parents) if each.exists())
    free_mb = shutil.disk_usage(there).free / 1e6
    good = os.access(there, os.W_OK) and free_mb > config.recording.least_free_mb
    hours = free_mb / (0.6 * 3600.0)
    return PreflightItem("storage", good, f"{folder}: {free_mb:.0f} MB free, about {hours:.0f} h of 126 scans a second")


def _display(config: RuntimeConfig) -> PreflightItem:
    from lgprjax.runtime.display.access import Access

    def address() -> str:
        Access(config)
        return f"http://{config.display.host}:{config.display.port}"

    return _tried("display", address)


def _cores(config: RuntimeConfig) -> PreflightItem:
    wanted = {config.control.core, config.supervision.registration_core} - {None}
    missing = wanted - set(os.sched_getaffinity(0))
    found = f"{len(os.sched_getaffinity(0))} cores"
    return PreflightItem(
        "cores", not missing, found if not missing else f"{found}; not there: {sorted(missing, key=str)}"
    )


def _lines(config: RuntimeConfig) -> Iterator[PreflightItem]:
    ports: list[tuple[str, PortTable, Port[Any]]] = []
    for source, name in (
        (Source.DRIVE_BY_WIRE, "drive_by_wire"),
        (Source.CONTROLLER, "controller"),
        (Source.RADAR, "radar"),
    ):
        known: PortTable | None = getattr(config.ports, name)
        if known is not None:
            ports.append((name, known, Port.frames(source, known.url, known.baud, name)))
    table = config.ports.gnss
    if table is not None:
        ports.append(("gnss", table, Port(Source.GNSS, table.url, table.baud, GnssParser())))
    time.sleep(_LISTEN_S)
    for name, table, port in ports:
        received, refused = len(port.take()), sum(port.refused.values())
        port.close()
        finding = f"{table.url}: {received} messages in {_LISTEN_S:g} s" + (f", {refused} refused" if refused else "")
        yield PreflightItem(name, received > 0, finding if port.openings else f"{table.url}: {port.problem}")


def _tried(name: str, look: Callable[[], str | Path | None]) -> PreflightItem:
    try:
        finding = look()
    except InputError as error:
        return PreflightItem(name, False, str(error))
    return PreflightItem(name, True, "" if finding is None else str(finding))
