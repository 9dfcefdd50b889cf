"""The configuration of the onboard runtime, ``CONFIG.toml``: paths are relative to the file's folder."""

import json
import re
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from lgprjax.config import BrokenRuleError, ConfigTable, TableKey, fill_table
from lgprjax.errors import InputError
from lgprjax.files import load_toml


class PortTable(ConfigTable):
    """A line to a device: a serial device or ``socket://host:port``, as pyserial's ``serial_for_url`` takes it."""

    url: str
    baud: int = Field(default=921600, gt=0)


class PortsTable(ConfigTable):
    """The lines. GNSS/INS speaks NMEA or u-blox UBX, the others ``data_schema/wire.toml``; ``RuntimeConfig`` says which
    a run needs.
    """

    drive_by_wire: PortTable | None = None
    controller: PortTable | None = None
    gnss: PortTable | None = None
    radar: PortTable | None = None

    @field_validator("drive_by_wire", "controller", "gnss", "radar")
    @classmethod
    def _can_be_opened(cls, port: PortTable | None) -> PortTable | None:
        """The lines of a vehicle are serial devices or sockets; pyserial knows more."""
        if port is not None and "://" in port.url and not re.fullmatch(r"socket://[^/\s]+:\d+", port.url):
            expected = "a serial device, such as /dev/ttyUSB0, or socket://HOST:PORT"
            raise BrokenRuleError("url", expected, repr(port.url))
        return port


class SweepTable(ConfigTable):
    """Frequencies of a stepped-frequency radar, as in ``radar_sweep_plan`` of ``data_schema/wire.toml``."""

    first_khz: int = Field(gt=0, lt=1 << 32)
    step_khz: int = Field(gt=0, lt=1 << 32)
    steps: int = Field(gt=1, lt=1 << 16)


class RadarTable(ConfigTable):
    """Settings sent to the radar before it scans.

    Attributes:
        sweep: frequencies; None: the radar's own.
        scan_period_us: period of the scans; 0: as planned.
        calibrate, look_up: whether to request a calibration and a look-up before the start, with the array over the
            ground and pointed at empty space, respectively.
        calibration: path of X.radar.h5, in place of the look-up that the radar records itself.
        channel_pitch_m, centre_frequency_mhz: spacing and frequency of the array in mode record, without a map.
    """

    sweep: SweepTable | None = None
    scan_period_us: int = Field(default=0, ge=0, le=1_000_000)
    calibrate: bool = False
    look_up: bool = False
    calibration: str | None = None
    channel_pitch_m: float | None = Field(default=None, gt=0.0, le=5.0)
    centre_frequency_mhz: float | None = Field(default=None, ge=1.0, le=10_000.0)

    @model_validator(mode="after")
    def _one_lookup(self) -> "RadarTable":
        if self.look_up and self.calibration is not None:
            raise BrokenRuleError("look_up", "false: calibration has the look-up", "true")
        return self


class RegistrationTable(ConfigTable):
    """The search, as in ``lgprjax register``.

    Attributes:
        search_m: half side of the square around the control loop's prior.
        window_m: length of the windows; unset, the shortest window of the ladder that reaches the risk.
        time_scale: travel time in the ground relative to the map; unset, it is estimated along the drive.
        risk: largest probability of a false match for an accepted fix, and for a scan that is evidence of the map's
            ground.
        search: of all places, by a particle swarm, or by a Bayes filter.
        finish: by Gauss-Newton, or by a particle swarm about each candidate.
    """

    search_m: float = Field(default=1.5, gt=0.0, le=5.0)
    window_m: float | None = Field(default=None, ge=0.0, le=10.0)
    time_scale: float | None = Field(default=None, gt=0.5, lt=2.0)
    risk: float = Field(default=1e-4, ge=1e-12, le=0.01)
    thresholds: str | None = None
    search: Literal["exhaustive", "swarm", "filter"] = "exhaustive"
    finish: Literal["newton", "swarm"] = "newton"

    @model_validator(mode="after")
    def _filter_alone(self) -> "RegistrationTable":
        if self.search == "filter":
            for name, given in (("window_m", self.window_m), ("thresholds", self.thresholds)):
                if given is not None:
                    raise BrokenRuleError(name, 'unset with search = "filter"', repr(given))
            if self.finish != "newton":
                raise BrokenRuleError("finish", '"newton" with search = "filter"', repr(self.finish))
        return self


class SensorsTable(ConfigTable):
    """Sensor properties not in their messages: delay and period of positions, sigmas, and slow errors of headings."""

    gnss_delay_s: float = Field(default=0.0, ge=0.0, le=1.0)
    gnss_period_s: float = Field(default=0.143, gt=0.0, le=2.0)
    gnss_sigma_m: float = Field(default=0.01, gt=0.0, le=10.0)
    heading_sigma_deg: float = Field(default=0.06, gt=0.0, le=20.0)
    heading_slow_deg: float = Field(default=0.12, ge=0.0, le=20.0)
    heading_slow_s: float = Field(default=60.0, gt=0.0, le=3600.0)
    odometer_sigma_mps: float = Field(default=0.03, gt=0.0, le=5.0)
    fix_heading_slow_deg: float = Field(default=0.25, ge=0.0, le=20.0)
    fix_changes_m: float = Field(default=4.0, gt=0.0, le=1000.0)


class ControlTable(ConfigTable):
    """The control loop.

    Attributes:
        fusion: source of the pose used for control.
        cross_sigmas_m: standard deviations of the position across the route: above the first the speed is capped, at
            the second the cap is ``slow_mps``, above the third the vehicle stops.
        slow_mps: speed cap of a counter-steered vehicle with a fault that it drives on with.
    """

    fusion: Literal["filter", "switch"] = "filter"
    cross_sigmas_m: list[float] = Field(default=[0.10, 0.15, 0.25], min_length=3, max_length=3)
    slow_mps: float = Field(default=2.0, gt=0.0, le=30.0)
    core: int | None = None
    realtime_priority: int | None = Field(default=None, ge=1, le=99)
    collect_garbage: Literal["never", "between"] = "between"
    set_speed_step_mps: float = Field(default=0.25, gt=0.0, le=2.0)
    fastest_engage_mps: float = Field(default=4.5, gt=0.0, le=30.0)
    override_torque_nm: float = Field(default=4.0, gt=0.0, le=50.0)

    @model_validator(mode="after")
    def _sigmas_rise(self) -> "ControlTable":
        free_m, slow_m, stop_m = self.cross_sigmas_m
        if not 0.0 < free_m < slow_m < stop_m <= 1.0:
            raise BrokenRuleError("cross_sigmas_m", "three rising numbers above 0, at most 1", str(self.cross_sigmas_m))
        return self


class CoverageTable(ConfigTable):
    """Work of a skid-steer vehicle on a field.

    Attributes:
        plan: path of X.cover.geojson; without a plan the vehicle does not drive, work by remote control is recorded,
            and corners can be marked.
        speed_mps: set speed locked by the buttons plus and minus.
        guidance: control law along the plan.
        spare_m: extra room of the fence beyond the plan's, for stopping, uncertainty and tracking.
        cell_m: side of the cells of the worked map.
        level: probability from which the page shows a cell as worked.
        shared_sigma_m: standard deviation per axis of the error shared by all positions, mainly of the base; added on
            the page's map.
        resume: path of the work of earlier runs to resume; written by ``run --resume``.
    """

    plan: str | None = None
    speed_mps: float = Field(default=0.3, gt=0.0, le=3.0)
    guidance: Literal["carrot", "pursuit"] = "carrot"
    spare_m: float = Field(default=0.8, ge=0.0, le=20.0)
    cell_m: float = Field(default=0.05, gt=0.0, le=1.0)
    level: float = Field(default=0.95, gt=0.5, lt=1.0)
    shared_sigma_m: float = Field(default=0.05, ge=0.0, le=1.0)
    resume: str | None = None


class RecordingTable(ConfigTable):
    """Recording of runs; ``mandatory``: the vehicle stops if recording fails."""

    folder: str = "runs"
    mandatory: bool = False
    segment_s: float = Field(default=60.0, gt=0.0)
    least_free_mb: int = Field(default=500, ge=0)


class DisplayTable(ConfigTable):
    """The operator's page. Any address but a loopback one demands a token."""

    host: str = "127.0.0.1"
    port: int = Field(default=8080, ge=0, le=65535)
    token: str | None = Field(default=None, min_length=16)
    origins: list[str] = Field(default_factory=list)


class OutputTable(ConfigTable):
    """Output of the corrected position.

    Attributes:
        nmea_port, nmea_host: TCP port and address at which every client gets GGA, HDT and GST; 0: a free port.
        nmea_serial: serial line of the sentences.
        rate_hz: rate of the sentences.
        live_port, live_host: websocket of the live view for Foxglove; needs the extra live.
    """

    nmea_port: int | None = Field(default=None, ge=0, le=65535)
    nmea_host: str = "127.0.0.1"
    nmea_serial: PortTable | None = None
    rate_hz: Literal[10, 25, 50] = 10
    live_port: int | None = Field(default=None, ge=0, le=65535)
    live_host: str = "127.0.0.1"


class SupervisionTable(ConfigTable):
    """Time limits of processes for silence once ready and for starting; registration's core; temperature limit."""

    control_s: float = Field(default=0.2, gt=0.0, le=60.0)
    others_s: float = Field(default=1.0, gt=0.0, le=60.0)
    start_s: float = Field(default=120.0, gt=0.0, le=3600.0)
    registration_core: int | None = None
    hottest_c: float = Field(default=95.0, gt=0.0, le=150.0)


class SimulationTable(ConfigTable):
    """The world of ``run --simulate``: an off-road course or a field, operator actions, and faults.

    Attributes:
        length_m, weather, scan_share: length, weather and scan divisor of a course.
        recording, gain_drift: data of its radar (finished traces or stepped-frequency sweeps), and the change of the
            receiver's gain over 20 minutes, half of it in the first 4.
        in_view: view of a radar that records sweeps: the ground or, to calibrate it, empty space or a metal plate.
        gnss_slow_m: standard deviation per axis of the slow position error on a course; 0: RTK with a base nearby.
        vehicle: numbers of the vehicle on a course that differ from those of ``scene.TrueVehicle``.
        field: path of X.geojson of a field, from which a missing plan is made.
        overlap, order, turning_room_m: options of that plan, see ``lgprjax cover plan``.
        script: operator actions: times in seconds since the vehicle was ready, and buttons pressed.
        faults: see ``simulation.devices``.
    """

    seed: int = 2
    length_m: float = Field(default=300.0, ge=60.0, le=2000.0)
    weather: Literal["clear", "snow", "rain", "frost", "years", "repaired"] = "clear"
    scan_share: int = Field(default=1, ge=1, le=6)
    drive_seed: int = 102
    recording: Literal["traces", "sweeps"] = "traces"
    gain_drift: float = Field(default=0.05, ge=-0.9, le=10.0)
    in_view: Literal["ground", "empty", "plate"] = "ground"
    gnss_slow_m: float = Field(default=0.3, ge=0.0, le=10.0)
    vehicle: dict[str, Any] = Field(default_factory=dict)
    field: str | None = None
    overlap: float = Field(default=0.2, ge=0.0, lt=1.0)
    order: Literal["zamboni", "boustrophedon", "racetrack", "free", "best"] = "zamboni"
    turning_room_m: float | None = Field(default=None, ge=0.0)
    script: list[dict[str, Any]] = Field(default_factory=list)
    faults: list[dict[str, Any]] = Field(default_factory=list)

    @model_validator(mode="after")
    def _sweeps_in_view(self) -> "SimulationTable":
        if self.in_view != "ground" and self.recording != "sweeps":
            raise BrokenRuleError("in_view", 'ground, or recording = "sweeps"', self.in_view)
        return self


class CalibrationTable(ConfigTable):
    """A manoeuvre of a calibration; ``lgprjax calibrate`` writes it.

    Attributes:
        step: name of the step.
        prompt: instructions to the crew, one line each, for the page.
        commands: actuators that the software moves once engaged; none: the manoeuvre is driven by hand.
        amplitude_rad: largest front angle of a commanded manoeuvre.
        fastest_mps: largest speed of a commanded manoeuvre, once the brake has been proven; before, 2 m/s.
        area_m: largest distance of the vehicle from the place of engagement.
    """

    step: str
    prompt: list[str] = Field(default_factory=list)
    commands: Literal["none", "steering", "pedals"] = "none"
    amplitude_rad: float = Field(default=0.2, gt=0.0, le=0.6)
    fastest_mps: float = Field(default=3.5, ge=2.0, le=8.0)
    area_m: float = Field(default=200.0, ge=30.0, le=2000.0)


class RuntimeConfig(ConfigTable):
    """Contents of a ``CONFIG.toml``.

    Attributes:
        file: path of the file.
        mode: drive: along routes, with map and radar or by GNSS/INS alone, or in a field; record: radar, positions and
            odometry, without commands, or with ``coverage`` a hand cart with a GNSS receiver alone; calibrate: a
            manoeuvre of ``[calibration]``.
        vehicle: vehicle file; may be missing, or unfinished, in mode record.
    """

    file: Path
    name: str
    mode: Literal["drive", "record", "calibrate"] = "drive"
    vehicle: str = ""
    map: str = ""
    routes: list[str] = Field(default_factory=list)
    cache: str | None = "cache"
    ports: PortsTable
    coverage: CoverageTable | None = None
    radar: RadarTable = RadarTable()
    registration: RegistrationTable = RegistrationTable()
    sensors: SensorsTable = SensorsTable()
    control: ControlTable = ControlTable()
    recording: RecordingTable = RecordingTable()
    display: DisplayTable = DisplayTable()
    supervision: SupervisionTable = SupervisionTable()
    output: OutputTable | None = None
    simulation: SimulationTable | None = None
    calibration: CalibrationTable | None = None

    @property
    def commands(self) -> bool:
        """Whether the run sends commands to the vehicle."""
        if self.mode == "calibrate":
            return self.calibration is not None and self.calibration.commands != "none"
        return self.mode == "drive"

    @model_validator(mode="after")
    def _one_work(self) -> "RuntimeConfig":
        """A recording, routes, or a field. A map needs a radar; without a map, the scans of a radar are recorded."""
        lines = [name for name in PortsTable.model_fields if getattr(self.ports, name) is not None]
        if (self.mode == "calibrate") != (self.calibration is not None):
            raise BrokenRuleError(
                "calibration", "a table in mode calibrate only, which lgprjax calibrate writes", self.mode
            )
        if self.mode == "calibrate":
            self._require(lines, ["drive_by_wire", "gnss", *(["controller"] if self.commands else [])])
            return self
        if self.mode == "record":
            if self.map or self.routes or self.output is not None:
                raise self._of_work("none of them in mode record, which needs no map and gives out no position")
            if self.coverage is not None and (lines != ["gnss"] or not self.vehicle or self.coverage.plan is not None):
                raise self._of_work("in mode record, [coverage] of a hand cart: ports.gnss alone, vehicle, and no plan")
            if not {"gnss", "radar"} & set(lines):
                raise BrokenRuleError("ports", "gnss or radar, or both", ", ".join(lines) or "none")
            return self
        self._require(lines, ["drive_by_wire", "controller", "gnss"])
        if self.coverage is not None:
            if self.map or self.routes:
                raise self._of_work("either [coverage], or map and routes")
            if self.output is not None:
                raise self._of_work("[output] only with a map: field runs give out no corrected position")
        elif not self.routes:
            raise self._of_work("routes, with or without map and ports.radar, or [coverage]")
        elif self.map and self.ports.radar is None:
            raise self._of_work("ports.radar with a map, or no map to drive by GNSS/INS alone")
        elif self.output is not None and not self.map:
            raise self._of_work("[output] only with a map: GNSS/INS alone gives no corrected position")
        return self

    def _require(self, lines: list[str], needed: list[str]) -> None:
        missing = [name for name in needed if name not in lines]
        if missing or not self.vehicle:
            place = f"ports.{missing[0]}" if missing else "vehicle"
            raise BrokenRuleError(place, 'a value, or mode = "record" to record without driving', "none")

    def _of_work(self, expected: str) -> BrokenRuleError:
        deciding = ("map", "routes", "coverage", "output")
        given = ", ".join(name for name in deciding if getattr(self, name))
        if self.ports.radar is not None:
            given += ", ports.radar"
        return BrokenRuleError("map, routes, coverage", expected, given.removeprefix(", ") or "none of these")

    def port(self, name: str) -> PortTable:
        """A line that a run of this mode has."""
        table: PortTable | None = getattr(self.ports, name)
        assert table is not None, name
        return table

    def path(self, named: str) -> Path:
        """A path of the configuration, ready to open."""
        return self.file.parent / named


def read_config(path: str | Path) -> RuntimeConfig:
    """Read a configuration.

    Raises:
        InputError: the file is missing, not TOML or of another kind, or a key is unknown, missing or has a wrong value.
    """
    file = Path(path)
    table = load_toml(file)
    other = next((words for key, words in _OTHER_FILES.items() if key in table), str(table.get("schema", "")))
    if other and "ports" not in table:
        expected = "the configuration of a run: name, vehicle, map and routes or [coverage], [ports]"
        raise InputError(file, "file", expected, other)
    return fill_table(RuntimeConfig, TableKey(file), {**table, "file": file.resolve()})


_OTHER_FILES = {
    "steering_kind": "a vehicle file (the key vehicle of a configuration names it)",
    "kind": "a study file of lgprjax tune",
    "drive": "a site file of lgprjax simulate",
}
"""Kind of another TOML file of this project, by a key that it has."""


# A configuration as text: the file that a run is started from, with its lines and paths.


def write_config(path: Path, config: RuntimeConfig) -> None:
    """Write a configuration with absolute paths, replacing the file.

    Raises:
        InputError: the file cannot be written.
    """
    from lgprjax.formats.store import atomic_output  # reading a configuration must not import HDF5

    table = config.model_dump(exclude={"file"}, exclude_none=True)
    for name in ("vehicle", "map", "cache"):
        if table.get(name):
            table[name] = str(config.path(table[name]))
    table["routes"] = [str(config.path(name)) for name in table["routes"]]
    paths = (
        *(("coverage", "plan"), ("coverage", "resume"), ("simulation", "field")),
        *(("registration", "thresholds"), ("radar", "calibration")),
    )
    for name, key in paths:
        if table.get(name, {}).get(key):
            table[name][key] = str(config.path(table[name][key]))
    table["recording"]["folder"] = str(config.path(config.recording.folder))
    with atomic_output(path, force=True) as temporary:
        temporary.write_text("\n".join(_lines(table, "")) + "\n", encoding="utf-8")


def _lines(table: dict[str, Any], prefix: str) -> list[str]:
    plain = {name: value for name, value in table.items() if not isinstance(value, dict)}
    lines = [f"{name} = {_value(value)}" for name, value in plain.items()]
    for name, inner in table.items():
        if isinstance(inner, dict):
            path = f"{prefix}{name}"
            lines += ["", f"[{path}]", *_lines(inner, f"{path}.")]
    return lines


def _value(value: Any) -> str:
    """TOML text of a value; JSON texts and numbers are valid TOML, and a table in a list is written inline."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(name)} = {_value(inner)}" for name, inner in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(_value(inner) for inner in value) + "]"
    return json.dumps(value)
