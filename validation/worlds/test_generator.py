"""The generator of worlds against what physics and its own table say."""

from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from lgprjax.formats import DriveLog
from validation.worlds.course import centreline_of, drive_along
from validation.worlds.days import Weather, decay, record, weather_of
from validation.worlds.drives import days_of, ground_of, write_live, write_passes
from validation.worlds.ground import (
    LIGHT_M_PER_NS,
    Ground,
    Scatterers,
    layer_traces,
    make_ground,
    point_echoes,
    pulse_of,
    two_way_path,
)
from validation.worlds.parameters import TABLE, World, draw_worlds, read_worlds, write_worlds
from validation.worlds.small import SMALL_WORLDS

SMALL = SMALL_WORLDS[0]


def silent(world: World) -> World:
    """The same world without noise, clutter or bounce: only its ground."""
    return replace(world, clutter=0.0, snr_half_db=80.0, bounce_m=0.0, roll_deg=0.0, encoding="int16", coupling=1e-6)


def test_the_table_is_as_it_was_drawn() -> None:
    stream = StringIO()
    write_worlds(draw_worlds(), stream)
    assert stream.getvalue() == TABLE.read_text(encoding="utf-8")


def test_the_table_covers_what_the_worlds_must() -> None:
    worlds = [world for world in read_worlds() if not world.beyond]
    assert len(worlds) == 30
    assert sum(world.channels >= 6 for world in worlds) == 20
    assert {world.channels for world in worlds} >= {1, 16}
    assert min(world.centre_mhz for world in worlds) < 120.0
    assert max(world.centre_mhz for world in worlds) > 800.0
    for world in worlds:
        coarsest = world.pitch_m if world.channels >= 6 else max(world.pitch_m, world.pass_spacing_m / world.channels)
        assert coarsest <= 0.501 * world.wavelength_m
        assert 0.95 <= world.rain_scale <= 1.08
        assert np.hypot(world.gnss_east_m, world.gnss_north_m) <= 1.5
    assert sum(world.gnss_stated for world in worlds) == 15
    assert sum(world.lookalike_m > 0.0 for world in worlds) == 10
    beyond = [world for world in read_worlds() if world.beyond]
    assert len(beyond) == 4
    assert all(0.59 <= world.pitch_m / world.wavelength_m <= 1.21 for world in beyond)


def test_the_ground_stays_above_the_noise() -> None:
    """By the laws of loss alone: 3 dB over half of the recorded time, in snow too."""
    for world in read_worlds():
        half_ns = np.asarray(0.5 * world.samples * world.sample_interval_ns)
        for day in ("clear", "snow", "rain"):
            weather = weather_of(world, day)
            more_loss = decay(world, half_ns, weather.loss_factor) / decay(world, half_ns, 1.0)
            lost_db = weather.loss_db + weather.noise_db - 20.0 * np.log10(float(more_loss))
            assert world.snr_half_db - lost_db >= 3.0, (world.number, day)


def test_a_refracted_path_is_the_quickest() -> None:
    """Fermat: of all points of the surface that a path may go through, Snell's is the one of least time."""
    rng = np.random.default_rng(1)
    offset, depth, height = rng.uniform(0.0, 3.0, 40), rng.uniform(0.1, 4.0, 40), rng.uniform(0.01, 0.4, 40)
    velocity = 0.11
    air, soil, sine = two_way_path(offset, depth, height, velocity)
    for n in range(len(offset)):

        def one_way_ns(at: float, n: int = n) -> float:
            return float(np.hypot(height[n], at) / LIGHT_M_PER_NS + np.hypot(depth[n], offset[n] - at) / velocity)

        best = minimize_scalar(one_way_ns, bounds=(0.0, offset[n]), method="bounded", options={"xatol": 1e-9})
        assert air[n] + soil[n] == pytest.approx(2.0 * best.fun, abs=1e-6)
        assert sine[n] == pytest.approx((offset[n] - best.x) / np.hypot(depth[n], offset[n] - best.x), abs=1e-4)


@pytest.mark.parametrize("time_scale", [1.0, 1.06])
def test_a_stone_is_heard_above_itself_at_its_two_way_time(time_scale: float) -> None:
    """Apex of the hyperbola in place and time, and the time of a flank, in the recorded traces."""
    world = silent(replace(SMALL, bend="straight", radius_m=0.0))
    line = centreline_of(world)
    depth, at = 0.9, 6.0
    east, north, _ = line.place(np.array([at]), np.array([0.0]))
    stone = Scatterers(east, north, np.array([depth]), np.array([5.0]))
    ground = make_ground(world, line, 0)
    ground = ground._replace(layers=np.zeros_like(ground.layers), points=stone)
    motion = drive_along(world, line, np.random.default_rng(2), 0.0, 0.0, 1.0, 11.0)
    weather = Weather(time_scale=time_scale)
    recorded = record(replace(world, gain_share=0.0), ground, motion, weather, np.random.default_rng(3))
    middle = world.channels // 2
    traces = recorded.traces[:, middle].astype(float) - recorded.zero_level
    envelope = np.abs(traces).max(axis=1)
    along, left = motion.antenna_at_m[:, middle], motion.antenna_left_m[:, middle]
    assert along[np.argmax(envelope)] == pytest.approx(at, abs=2.5 * world.scan_spacing_m)
    for away in (0.0, 0.35):
        scan = int(np.argmin(np.abs(along - at - away)))
        peak = np.argmax(np.abs(traces[scan]))
        heard_ns = peak * world.sample_interval_ns - recorded.time_zero_ns
        offset = np.hypot(along[scan] - at, left[scan])
        # Straight down, the path needs no refraction; beside, the least of all surface points is what light takes.
        points = np.linspace(0.0, offset, 4001)
        air, soil = np.hypot(world.height_m, points), np.hypot(depth, offset - points)
        due_ns = 2.0 * np.min(air / LIGHT_M_PER_NS + soil / world.velocity_m_per_ns * time_scale)
        assert heard_ns == pytest.approx(due_ns, abs=0.06 * world.period_ns)


def test_rain_stretches_the_time_of_the_layers() -> None:
    """One strong interface at a known depth: its arrival moves by the day's factor, from the surface on."""
    world = silent(replace(SMALL, bend="straight", radius_m=0.0, gain_share=0.0))
    line = centreline_of(world)
    ground = make_ground(world, line, 0)
    sample = 110
    layers = np.zeros_like(ground.layers)
    layers[:, sample] = 5.0
    ground = ground._replace(layers=layers, points=ground.points._replace(amplitude=0.0 * ground.points.amplitude))
    motion = drive_along(world, line, np.random.default_rng(2), 0.0, 0.0, 1.0, 8.0)
    for factor in (0.96, 1.0, 1.07):
        recorded = record(world, ground, motion, Weather(time_scale=factor), np.random.default_rng(3))
        peak = np.argmax(np.abs(recorded.traces.astype(float).mean(axis=(0, 1)) - recorded.zero_level))
        due_ns = 2.0 * world.height_m / LIGHT_M_PER_NS + factor * sample * world.sample_interval_ns
        assert peak * world.sample_interval_ns - recorded.time_zero_ns == pytest.approx(
            due_ns, abs=0.6 * world.sample_interval_ns
        )


def test_echoes_fade_with_path_and_angle() -> None:
    world = replace(SMALL, beam_sine=0.25, velocity_m_per_ns=0.12)
    stones = Scatterers(np.zeros(2), np.zeros(2), np.array([0.5, 1.0]), np.ones(2))
    height = 0.1
    echoes = point_echoes(world, stones, np.array([[0.0, 0.0, height]]), np.ones(1))
    assert len(echoes.trace) == 2
    assert echoes.amplitude[0] / echoes.amplitude[1] == pytest.approx((1.0 + height) / (0.5 + height))
    # Where the angle in the soil has the beam's sine, half of the amplitude is left beside the spreading.
    in_soil, in_air = np.arcsin(0.25), np.arcsin(0.25 * LIGHT_M_PER_NS / 0.12)
    offset = 0.5 * np.tan(in_soil) + height * np.tan(in_air)
    path = 0.5 / np.cos(in_soil) + height / np.cos(in_air)
    aside = point_echoes(world, stones, np.array([[offset, 0.0, height]]), np.ones(1))
    assert aside.amplitude[0] / echoes.amplitude[0] == pytest.approx(0.5 * (0.5 + height) / path, rel=1e-6)


def test_layers_are_as_loud_and_as_smooth_as_the_world_says() -> None:
    """Unit RMS through the pulse; neighbours half a wavelength apart alike, those of several lengths not."""
    world = replace(SMALL, horizons=0, law="gaussian", correlation_wavelengths=1.0)
    ground = make_ground(world, centreline_of(world), 0)
    at = np.linspace(0.0, world.route_m, 300)
    traces = layer_traces(ground, at, np.zeros_like(at))
    heard = np.apply_along_axis(np.convolve, 1, traces, pulse_of(world), "same")
    assert np.sqrt(np.mean(heard**2)) == pytest.approx(1.0, rel=0.15)

    def alike(apart_m: float) -> float:
        other = layer_traces(ground, np.minimum(at + apart_m, world.route_m), np.zeros_like(at))
        return float(np.sum(traces * other) / np.sqrt(np.sum(traces**2) * np.sum(other**2)))

    assert alike(0.25 * world.wavelength_m) > 0.7
    assert alike(6.0 * world.wavelength_m) < 0.3


def test_a_place_is_the_same_ground_from_whichever_drive() -> None:
    """Interpolated at the cells themselves the layers are the cells; a place beyond them is refused."""
    ground = make_ground(SMALL, centreline_of(SMALL), 0)
    rows, columns = np.array([5, 40, 90]), np.array([3, 6, 4])
    along, across = ground.along_m + rows * ground.step_m, ground.across_m + columns * ground.step_m
    found = layer_traces(ground, along, across)
    np.testing.assert_allclose(found, ground.layers[rows * ground.shape[1] + columns], atol=1e-4)
    with pytest.raises(ValueError, match="cells"):
        layer_traces(ground, np.array([1e3]), np.array([0.0]))


def test_lookalike_ground_repeats_and_forgets() -> None:
    world = replace(SMALL, lookalike_m=0.6, lookalike_memory=0.9)
    line = centreline_of(world)

    def repeats(ground: Ground, periods: int) -> float:
        cells = round(world.lookalike_m / ground.step_m)
        field = ground.layers.reshape(*ground.shape, -1)
        one, other = field[: -periods * cells], field[periods * cells :]
        return float(np.sum(one * other) / np.sqrt(np.sum(one**2) * np.sum(other**2)))

    periodic = ground_of(world, line, "lookalike")
    assert repeats(periodic, 1) == pytest.approx(0.9, abs=0.06)
    assert repeats(periodic, 4) == pytest.approx(0.9**4, abs=0.12)
    assert abs(repeats(ground_of(world, line, "clear"), 4)) < 0.3


def test_a_seed_makes_one_world_and_another_another(tmp_path: Path) -> None:
    line = centreline_of(SMALL)
    drives = []
    for name in ("once", "again"):
        (tmp_path / name).mkdir()
        ground = ground_of(SMALL, line, "clear")
        drives.append(write_live(SMALL, ground, "clear", tmp_path / name))
    (tmp_path / "other").mkdir()
    impostor = write_live(SMALL, ground_of(SMALL, line, "impostor"), "impostor", tmp_path / "other")
    with DriveLog.open(drives[0].path) as first, DriveLog.open(drives[1].path) as second:
        traces = first.read_traces(0, first.scans)[0]
        np.testing.assert_array_equal(traces, second.read_traces(0, second.scans)[0])
    with DriveLog.open(impostor.path) as log:
        np.testing.assert_array_equal(impostor.motion.antenna_m, drives[0].motion.antenna_m)
        other = log.read_traces(0, log.scans)[0]
    deep = slice(traces.shape[2] // 4, traces.shape[2] // 2)
    one, two = (part[:, :, deep] - part[:, :, deep].mean(axis=0) for part in (traces, other))
    assert abs(np.sum(one * two) / np.sqrt(np.sum(one**2) * np.sum(two**2))) < 0.2


def test_logs_say_what_their_sensors_say(tmp_path: Path) -> None:
    """Bias, jump and stated sigmas in the logs; odometry by its scale, or by chords that count the jump."""
    world = replace(SMALL, gnss_stated=False)
    line = centreline_of(world)
    ground = ground_of(world, line, "clear")
    assert "lookalike" not in days_of(replace(world, lookalike_m=0.0))
    drives = {day: write_live(world, ground, day, tmp_path) for day in ("clear", "gps_jump", "gps_jump_chords")}
    travelled = {}
    for day, drive in drives.items():
        with DriveLog.open(drive.path) as log:
            said = log.description
        assert said.navigation.sigma_east_m is None
        travelled[day] = said.odometry.distance_m[-1]
        true = np.interp(said.odometry.time_s[-1], drive.motion.time_s, drive.motion.travel_m)
        if day != "gps_jump_chords":
            assert travelled[day] == pytest.approx(true * (1.0 + world.odometer_scale), abs=0.006)
        assert np.mean(drive.recording.signal_db >= 3.0) >= 0.5
    # There and back, each a side of a triangle with what the vehicle went meanwhile: at least 2.1 m less that.
    lengths = {day: drive.motion.travel_m[-1] for day, drive in drives.items()}
    step_m = world.speed_mps / 10.0
    added = travelled["gps_jump_chords"] - lengths["gps_jump_chords"]
    assert 2.0 * (np.hypot(1.5, 1.5) - 2.0 * step_m) < added < 2.0 * np.hypot(1.5, 1.5) + 0.2
    bias = np.array([world.gnss_east_m, world.gnss_north_m])
    off = drives["clear"].label_error_m.mean(axis=0) - bias
    lever = np.radians(world.heading_deg) * world.antenna_x_m
    assert np.all(np.abs(off) < 3.0 * world.gnss_wander_m + 3.0 * lever)
    jumped = drives["gps_jump"].label_error_m
    middle = np.argmin(np.abs(drives["gps_jump"].motion.antenna_at_m[:, 0] - world.antenna_x_m - 0.5 * world.route_m))
    assert np.all(np.abs(jumped[middle] - jumped[[0, -1]].mean(axis=0) - 1.5) < 0.5)


def test_map_passes_state_their_labels(tmp_path: Path) -> None:
    world = SMALL
    passes = write_passes(world, ground_of(world, centreline_of(world), "clear"), tmp_path)
    assert len(passes) == world.passes
    for drive in passes:
        with DriveLog.open(drive.path) as log:
            sigma = log.description.navigation.sigma_east_m
        assert sigma is not None
        np.testing.assert_allclose(sigma, world.label_sigma_m)
    spread = np.sqrt(np.mean(np.concatenate([drive.label_error_m for drive in passes]) ** 2))
    assert 0.3 * world.label_sigma_m < spread < 2.5 * world.label_sigma_m
