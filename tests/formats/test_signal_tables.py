"""Signals of a vehicle from CSV, Parquet and MCAP: units converted, checked, and nothing written that is wrong."""

from pathlib import Path

import numpy as np
import pytest
from mcap.writer import Writer

from cli.test_tune import run
from formats.mcap_sample import Message, attitude_of, header_of, odometry_of, position_of, write_recording
from lgprjax.errors import InputError
from lgprjax.formats import VehicleLog, check_file
from lgprjax.formats.ros import layout_of
from lgprjax.formats.signal_tables import import_signals
from lgprjax.frames import LocalFrame

_MAP = Path(__file__).parents[2] / "tuning" / "signals.toml"
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
    assert run("import", "signals", file, "--map", _MAP, "-o", tmp_path / "a.drive.h5") == 0
    check_log(tmp_path / "a.drive.h5")
    assert "assumed, as nothing says it: height: 0 m" in " ".join(capsys.readouterr().out.split())
    assert run("import", "signals", file, "--map", _MAP, "-o", tmp_path / "a.drive.h5") == 1


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
def test_a_table_of_another_separator_becomes_the_same(tmp_path: Path, separator: str, comma: bool) -> None:
    """As spreadsheets write it where the comma is the decimal sign; some end their rows with empty cells."""
    file = write_csv(tmp_path / "a.csv", columns())
    text = file.read_text().replace(",", separator)
    head, _, rows = text.partition("\n")
    rows = rows.replace(".", ",") if comma else rows
    file.write_text(head + "\n" + rows.replace("\n", f"{separator}\n"))
    import_signals(file, _MAP, tmp_path / "a.drive.h5")
    check_log(tmp_path / "a.drive.h5")


def test_cells_that_are_no_numbers_are_counted(tmp_path: Path) -> None:
    file = write_csv(tmp_path / "a.csv", columns())
    rows = file.read_text().splitlines()
    for row, word in ((9, "N/A"), (10, "err"), (11, ""), (12, "1_0"), (13, "inf")):
        cells = rows[row].split(",")
        rows[row] = ",".join([cells[0], word, *cells[2:]])
    file.write_text("\n".join(rows) + "\n")
    found = import_signals(file, _MAP, tmp_path / "a.drive.h5")
    assert found.signals["speed"] == _COUNT - 5
    assert found.left_out == {
        "speed": "3 of 398 cells of column 'v_kmh' are no numbers, the first 'err' in row 11",
    }


def test_a_parquet_file_becomes_the_same(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = pytest.importorskip("pyarrow").table(columns())
    parquet.write_table(table, tmp_path / "a.parquet")
    import_signals(tmp_path / "a.parquet", _MAP, tmp_path / "a.drive.h5")
    check_log(tmp_path / "a.drive.h5")


def test_messages_become_a_drive_log(tmp_path: Path) -> None:
    """Each signal by its own messages and clock."""
    definition = "float64 value\nfloat64 other\n"
    layout = layout_of("test_msgs/msg/Pair", definition)
    topics = {"/wheels": ("wheel_right_deg", "v_kmh"), "/imu": ("yaw_rate_dps", "throttle_pct")}
    table = columns()
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        schema = writer.register_schema("test_msgs/msg/Pair", "ros2msg", definition.encode())
        for topic, (first, second) in topics.items():
            channel = writer.register_channel(topic, "cdr", schema)
            for row in range(_COUNT):
                at = 10**18 + 20_000_000 * row + (3_000_000 if topic == "/imu" else 0)
                data = layout.encode({"value": table[first][row], "other": table[second][row]})
                writer.add_message(channel, at, data, at)
        writer.finish()
    (tmp_path / "m.toml").write_text(
        '[signals.speed]\ncolumn = "/wheels:other"\nunit = "km/h"\n'
        '[signals.wheel_angle]\ncolumn = "/wheels:value"\nunit = "deg"\nscale = -1.0\n'
        '[signals.yaw_rate]\ncolumn = "/imu:value"\nunit = "deg/s"\n'
    )
    found = import_signals(tmp_path / "a.mcap", tmp_path / "m.toml", tmp_path / "a.drive.h5")
    assert check_file(tmp_path / "a.drive.h5") == []
    assert found.signals == {"speed": _COUNT, "wheel_angle": _COUNT, "yaw_rate": _COUNT}
    assert "reckoned" in found.assumed["positions"]
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
    found = import_signals(tmp_path / "a.parquet", _MAP.with_name("signals_parquet.toml"), tmp_path / "a.drive.h5")
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
    found = import_signals(tmp_path / "a.mcap", _MAP.with_name("signals_mcap.toml"), tmp_path / "a.drive.h5")
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
    ("change", "map_change", "message"),
    [
        ({"t_ms": None}, None, r"signals\.time: expected a column of a\.csv: .*, found 't_ms'"),
        ({"wheel_right_deg": 400.0}, None, r"wheel_angle from -1.3 to 1.3 once converted \(is the unit deg\?\)"),
        ({"t_ms": 0.0}, None, "times that rise"),
        ({"v_kmh": np.nan}, None, "20 numbers or more, found 0"),
        ({}, ('unit = "km/h"', 'unit = "knots"'), "signals.speed.unit: expected m/s or km/h or mph"),
        ({}, ("[signals.speed]", "[signals.velocity]"), "signals.velocity: expected one of"),
        ({}, ('[signals.speed]\ncolumn = "v_kmh"\nunit = "km/h"\n', ""), "expected travel or speed"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(
    tmp_path: Path, change: dict[str, float | None], map_change: tuple[str, str] | None, message: str
) -> None:
    table = columns()
    for name, value in change.items():
        if value is None:
            del table[name]
        else:
            table[name] = np.full(_COUNT, value)
    file = write_csv(tmp_path / "a.csv", table)
    text = _MAP.read_text()
    (tmp_path / "m.toml").write_text(text if map_change is None else text.replace(*map_change))
    with pytest.raises(InputError, match=message) as told:
        import_signals(file, tmp_path / "m.toml", tmp_path / "a.drive.h5")
    assert "\n" not in str(told.value)
    assert not (tmp_path / "a.drive.h5").exists()


def test_a_yaw_at_other_times_than_the_positions_turns_through_no_circle(tmp_path: Path) -> None:
    """Driving west, where yaw jumps from 180 to -180 degrees: between two messages it is not interpolated through 0."""
    definition = "float64 value\nfloat64 other\n"
    layout = layout_of("test_msgs/msg/Pair", definition)
    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2", "test")
        schema = writer.register_schema("test_msgs/msg/Pair", "ros2msg", definition.encode())
        gnss, ins = (writer.register_channel(topic, "cdr", schema) for topic in ("/gnss", "/ins"))
        for row in range(_COUNT):
            at = 10**18 + 20_000_000 * row
            place = layout.encode({"value": 46.0, "other": 11.0 - 1e-6 * row})
            writer.add_message(gnss, at, place, at)
            turned = layout.encode({"value": 179.0 if row % 2 else -179.0, "other": 5.0})
            writer.add_message(ins, at + 9_000_000, turned, at + 9_000_000)
        writer.finish()
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
