"""Signals of a vehicle from CSV, Parquet and MCAP: units converted, checked, and nothing written that is wrong."""

import re
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from formats.mcap_sample import Message, attitude_of, header_of, odometry_of, position_of, write_recording
from lgprjax.cli import main
from lgprjax.formats import VehicleLog, check_file
from lgprjax.formats.ros import layout_of
from lgprjax.formats.signal_tables import import_signals
from lgprjax.frames import LocalFrame
from refusals import printed_refusal, refused

SIGNAL_MAP = Path(__file__).parents[2] / "tuning" / "signals.toml"
_COUNT = 400


def columns() -> dict[str, np.ndarray]:
    """A drive at 50 Hz along a bend to the left, in the units of tuning/signals.toml."""
    t = 0.02 * np.arange(_COUNT)
    yaw = 0.05 * t
    x, y = np.cumsum(5.0 * np.cos(yaw) * 0.02), np.cumsum(5.0 * np.sin(yaw) * 0.02)
    return {
        "t_ms": 1e3 * t + 5000.0,
        "v_kmh": np.full(_COUNT, 18.0),
        "lat": 46.0 + np.degrees(y / 6.37e6),
        "lon": 11.0 + np.degrees(x / (6.378e6 * np.cos(np.radians(46.0)))),
        "heading": np.mod(90.0 - np.degrees(yaw), 360.0),
        "yaw_rate_dps": np.full(_COUNT, np.degrees(0.05)),
        "wheel_right_deg": -2.0 - 0.5 * np.sin(t),
        "command_right_deg": np.full(_COUNT, -2.0),
        "supply_mv": np.full(_COUNT, 23_500.0),
        "throttle_pct": np.full(_COUNT, 40.0),
    }


def write_csv(path: Path, table: dict[str, np.ndarray]) -> Path:
    rows = [
        ",".join(table),
        *(",".join(f"{value!r}" for value in map(float, row)) for row in zip(*table.values(), strict=True)),
    ]
    path.write_text("\n".join(rows) + "\n")
    return path


def check_log(path: Path) -> None:
    assert check_file(path) == []
    log = VehicleLog.open(path)
    assert log.vehicle is not None
    assert log.serial_number == "SIM-1"
    np.testing.assert_allclose(np.diff(log.odometry.distance_m), 5.0 * 0.02, rtol=1e-6)
    np.testing.assert_allclose(log.vehicle["yaw_rate_radps"], 0.05, rtol=1e-6)
    time_s = log.vehicle["time_s"]
    np.testing.assert_allclose(log.vehicle["wheel_angle_rad"], np.radians(2.0 + 0.5 * np.sin(time_s)), atol=2e-6)
    np.testing.assert_allclose(log.vehicle["supply_v"], 23.5)
    np.testing.assert_allclose(log.vehicle["throttle"], 0.4)
    assert log.navigation.heading_deg[0] == pytest.approx(90.0)


def test_a_csv_file_becomes_a_drive_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = write_csv(tmp_path / "a.csv", columns())
    command = ["import", "signals", str(file), "--columns", str(SIGNAL_MAP), "-o", str(tmp_path / "a.drive.h5")]
    for status in (0, 1):
        with pytest.raises(SystemExit) as stopped:
            main(command)
        assert stopped.value.code == status
    told = capsys.readouterr()
    assert re.search(r"\bheight\b.*\b0 m\b", told.out)
    printed_refusal(told.err).check("output", "--force", file="a.drive.h5")
    check_log(tmp_path / "a.drive.h5")


@pytest.mark.parametrize(("separator", "comma"), [(";", True), ("\t", False)])
def test_a_table_of_another_separator_becomes_the_same(tmp_path: Path, separator: str, comma: bool) -> None:
    """As spreadsheets write it where the comma is the decimal sign; some end their rows with empty cells."""
    file = write_csv(tmp_path / "a.csv", columns())
    text = file.read_text().replace(",", separator)
    head, _, rows = text.partition("\n")
    rows = rows.replace(".", ",") if comma else rows
    file.write_text(head + "\n" + rows.replace("\n", f"{separator}\n"))
    import_signals(file, SIGNAL_MAP, tmp_path / "a.drive.h5")
    check_log(tmp_path / "a.drive.h5")


def test_cells_that_are_no_numbers_are_counted(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "a.csv", columns())
    rows = file.read_text().splitlines()
    for row, word in ((9, "N/A"), (10, "err"), (11, ""), (12, "1_0"), (13, "inf")):
        cells = rows[row].split(",")
        rows[row] = ",".join([cells[0], word, *cells[2:]])
    file.write_text("\n".join(rows) + "\n")
    found = import_signals(file, SIGNAL_MAP, tmp_path / "a.drive.h5")
    assert found.signals["speed"] == _COUNT - 5
    assert list(found.left_out) == ["speed"]
    for value in ("3 of 398", "'v_kmh'", "'err'", "row 11"):
        assert value in found.left_out["speed"]


def _write_pairs(path: Path, topics: dict[str, tuple[np.ndarray, np.ndarray, int]]) -> None:
    """Messages of two numbers at 50 Hz: of each topic the numbers and by how many ns it is late."""
    definition = "float64 value\nfloat64 other\n"
    layout = layout_of("test_msgs/msg/Pair", definition)
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        schema = writer.register_schema("test_msgs/msg/Pair", "ros2msg", definition.encode())
        for topic, (values, others, late_ns) in topics.items():
            channel = writer.register_channel(topic, "cdr", schema)
            for row, (value, other) in enumerate(zip(values, others, strict=True)):
                at = 10**18 + 20_000_000 * row + late_ns
                writer.add_message(channel, at, layout.encode({"value": value, "other": other}), at)
        writer.finish()


def test_messages_become_a_drive_log(tmp_path: Path) -> None:
    """Each signal by its own messages and clock."""
    table = columns()
    wheels, imu = (
        (table["wheel_right_deg"], table["v_kmh"], 0),
        (table["yaw_rate_dps"], table["throttle_pct"], 3_000_000),
    )
    _write_pairs(tmp_path / "a.mcap", {"/wheels": wheels, "/imu": imu})
    (tmp_path / "m.toml").write_text(
        '[signals.speed]\ncolumn = "/wheels:other"\nunit = "km/h"\n'
        '[signals.wheel_angle]\ncolumn = "/wheels:value"\nunit = "deg"\nscale = -1.0\n'
        '[signals.yaw_rate]\ncolumn = "/imu:value"\nunit = "deg/s"\n'
    )
    found = import_signals(tmp_path / "a.mcap", tmp_path / "m.toml", tmp_path / "a.drive.h5")
    assert check_file(tmp_path / "a.drive.h5") == []
    assert found.signals == {"speed": _COUNT, "wheel_angle": _COUNT, "yaw_rate": _COUNT}
    assert "positions" in found.assumed
    log = VehicleLog.open(tmp_path / "a.drive.h5")
    assert log.vehicle is not None
    wheel_s = log.vehicle["time_s"]
    np.testing.assert_allclose(log.vehicle["wheel_angle_rad"], np.radians(2.0 + 0.5 * np.sin(wheel_s)), atol=2e-5)
    # A quarter of a radian to the left in five seconds.
    turned = np.unwrap(np.radians(log.navigation.heading_deg))
    assert turned[0] - np.interp(5.0, log.navigation.time_s, turned) == pytest.approx(0.25, abs=2e-3)


def test_the_example_of_a_parquet_file_is_one(tmp_path: Path) -> None:
    """tuning/signals_parquet.toml: dates, feet of travel, metres of UTM, volts and counts."""
    parquet = pytest.importorskip("pyarrow.parquet")
    t = 0.02 * np.arange(_COUNT)
    table = {
        "timestamp": np.datetime64("2026-03-01T08:00:00", "ns") + (1e9 * t).astype("timedelta64[ns]"),
        "odometer_ft": 5.0 * t / 0.3048,
        "utm_east_m": 700_000.0 + 5.0 * t,
        "utm_north_m": np.full(_COUNT, 5_100_000.0),
        "heading_rad": np.full(_COUNT, np.pi / 2),
        "sigma_m": np.full(_COUNT, 0.02),
        "yaw_rate_dps": np.zeros(_COUNT),
        "pot_mv": 2430.0 + 100.0 * np.sin(t),
        "encoder": (12_000.0 * 0.05 * np.sin(t)).round().astype(np.int64),
        "command_deg": np.full(_COUNT, 4.5),
        "throttle": np.full(_COUNT, 0.3),
        "brake_pct": np.zeros(_COUNT),
        "mode": np.full(_COUNT, 3),
    }
    parquet.write_table(pytest.importorskip("pyarrow").table(table), tmp_path / "a.parquet")
    found = import_signals(
        tmp_path / "a.parquet", SIGNAL_MAP.with_name("signals_parquet.toml"), tmp_path / "a.drive.h5"
    )
    assert check_file(tmp_path / "a.drive.h5") == []
    assert found.assumed == {"height": "0 m"}
    log = VehicleLog.open(tmp_path / "a.drive.h5")
    assert log.vehicle is not None
    np.testing.assert_allclose(np.diff(log.odometry.distance_m), 0.1, rtol=1e-6)
    np.testing.assert_allclose(log.vehicle["steering_command_rad"], np.radians(3.0), rtol=1e-6)
    np.testing.assert_allclose(log.vehicle["steering_potentiometer_v"], 2.43 + 0.1 * np.sin(t), atol=1e-6)
    np.testing.assert_array_equal(log.vehicle["encoder_counts"], table["encoder"])
    np.testing.assert_array_equal(log.vehicle["mode"], 3)
    np.testing.assert_allclose(log.navigation.heading_deg, 90.0)
    track = log.navigation
    place = track.latitude_deg, track.longitude_deg, track.height_m
    east, north, _ = LocalFrame(*(float(values[0]) for values in place)).to_local(*place)
    # The grid's metres are 0.9996 to 1.0001 long there, and its north 1.9 degrees off.
    np.testing.assert_allclose(np.hypot(east, north), 5.0 * t, rtol=1e-3, atol=1e-6)


def test_the_example_of_a_recording_is_one(tmp_path: Path) -> None:
    """tuning/signals_mcap.toml: what a ROS 2 user records, each topic at its own rate, by the times of its headers."""
    messages: list[Message] = []
    for at in np.arange(0.0, 8.0, 0.02):
        stamped = {"header": header_of(at)}
        imu = attitude_of(at, 0.05 * at, angular_velocity={"x": 0.0, "y": 0.0, "z": 0.05})
        angle, command = 0.04 + 0.01 * np.sin(at), 0.05
        messages += [
            ("/imu/data", "sensor_msgs/msg/Imu", at, imu),
            ("/imu/euler", "geometry_msgs/msg/Vector3Stamped", at, {**stamped, "vector": {"z": 0.05 * at}}),
            ("/odometry", "nav_msgs/msg/Odometry", at, odometry_of(at, 5.0 * at, 5.0)),
            ("/steering/joint_states", "sensor_msgs/msg/JointState", at, {**stamped, "position": [angle, 0.0]}),
            ("/drive/command", "ackermann_msgs/msg/AckermannDriveStamped", at,
             {**stamped, "drive": {"steering_angle": command}}),
        ]  # fmt: skip
    for at in np.arange(0.0, 8.0, 0.2):
        messages += [
            ("/gnss/fix", "sensor_msgs/msg/NavSatFix", at, position_of(at, 5.0 * at)),
            ("/battery", "sensor_msgs/msg/BatteryState", at, {"header": header_of(at), "voltage": 24.5}),
        ]
    write_recording(tmp_path / "a.mcap", sorted(messages, key=lambda message: message[2]))
    found = import_signals(tmp_path / "a.mcap", SIGNAL_MAP.with_name("signals_mcap.toml"), tmp_path / "a.drive.h5")
    assert check_file(tmp_path / "a.drive.h5") == []
    assert (found.signals["wheel_angle"], found.signals["latitude"], found.assumed) == (400, 40, {})
    log = VehicleLog.open(tmp_path / "a.drive.h5")
    assert log.vehicle is not None
    at = log.vehicle["time_s"]
    np.testing.assert_allclose(log.vehicle["wheel_angle_rad"], 0.04 + 0.01 * np.sin(at), atol=1e-6)
    np.testing.assert_allclose(log.vehicle["steering_command_rad"], 0.05, rtol=1e-6)
    np.testing.assert_allclose(log.vehicle["yaw_rate_radps"], 0.05, rtol=1e-6)
    np.testing.assert_allclose(log.vehicle["supply_v"], 24.5)
    np.testing.assert_allclose(log.navigation.height_m, 430.0)
    turned = np.unwrap(np.radians(log.navigation.heading_deg))
    np.testing.assert_allclose(turned[0] - turned, 0.05 * log.navigation.time_s, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "map_change", "place", "values"),
    [
        ({"t_ms": None}, None, "signals.time", ("a.csv", "'t_ms'")),
        ({"wheel_right_deg": 400.0}, None, "column 'wheel_right_deg'", ("wheel_angle", -1.3, 1.3, "deg")),
        ({"t_ms": 0.0}, None, "time of 'v_kmh'", ()),
        ({"v_kmh": np.nan}, None, "column 'v_kmh'", (20, "0")),
        ({}, ('unit = "km/h"', 'unit = "knots"'), "signals.speed.unit", ("m/s or km/h or mph", "'knots'")),
        ({}, ("[signals.speed]", "[signals.velocity]"), "signals.velocity", ("speed",)),
        ({}, ('[signals.speed]\ncolumn = "v_kmh"\nunit = "km/h"\n', ""), "signals", ("travel", "speed", "a.csv")),
    ],
)
def test_what_is_wrong_is_refused_and_nothing_is_written(
    tmp_path: Path,
    change: dict[str, float | None],
    map_change: tuple[str, str] | None,
    place: str,
    values: tuple[object, ...],
) -> None:
    table = columns()
    for name, value in change.items():
        if value is None:
            del table[name]
        else:
            table[name] = np.full(_COUNT, value)
    file = write_csv(tmp_path / "a.csv", table)
    text = SIGNAL_MAP.read_text()
    (tmp_path / "m.toml").write_text(text if map_change is None else text.replace(*map_change))
    with refused(place, *values):
        import_signals(file, tmp_path / "m.toml", tmp_path / "a.drive.h5")
    assert not (tmp_path / "a.drive.h5").exists()


def test_a_yaw_at_other_times_than_the_positions_turns_through_no_circle(tmp_path: Path) -> None:
    """Driving west, where yaw jumps from 180 to -180 degrees: between two messages it is not interpolated through 0."""
    rows = np.arange(_COUNT)
    west, back = (
        (np.full(_COUNT, 46.0), 11.0 - 1e-6 * rows, 0),
        (np.where(rows % 2, 179.0, -179.0), np.full(_COUNT, 5.0), 9_000_000),
    )
    _write_pairs(tmp_path / "a.mcap", {"/gnss": west, "/ins": back})
    (tmp_path / "m.toml").write_text(
        '[signals.latitude]\ncolumn = "/gnss:value"\nunit = "deg"\n'
        '[signals.longitude]\ncolumn = "/gnss:other"\nunit = "deg"\n'
        '[signals.yaw]\ncolumn = "/ins:value"\nunit = "deg"\n'
        '[signals.speed]\ncolumn = "/ins:other"\nunit = "m/s"\n'
    )
    import_signals(tmp_path / "a.mcap", tmp_path / "m.toml", tmp_path / "a.drive.h5")
    heading_deg = VehicleLog.open(tmp_path / "a.drive.h5").navigation.heading_deg
    assert len(heading_deg) == _COUNT
    np.testing.assert_allclose(heading_deg, 270.0, atol=1.01)
