"""One step of the Bayes filter against NumPy, what it must and must not conclude, and drives of the canonical site."""

from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from batch.other_days import drive_over, village
from canon.site import Site
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.batch.register import true_errors
from lgprjax.cli import main
from lgprjax.formats import DriveLog, MapFile, read_fixes
from lgprjax.registration import RegisterOptions, Track
from lgprjax.registration.bayes.filter import FilterState, Model, Posterior, Stop, begin, run, weigh
from lgprjax.registration.bayes.heading import HeadingError, turn_between
from lgprjax.registration.bayes.likelihood import RHOS, Likelihood, measure_likelihood
from lgprjax.registration.bayes.score import LatticeGround, Surface, lattice_ground
from lgprjax.scene import WEATHER
from lgprjax.subsurface import Tile

PLANES, CHANNELS, KEPT, SHAPE, REACH = 3, 4, 6, (13, 11), (4, 4)
FACING = 0.8, 0.6
STEP_M = np.array([0.08, 0.11])
NEIGHBOUR = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]], float)
LOST, FOREIGN, BACK, MIXING, SPACING_M = 2e-3, 3e-3, 4e-2, 0.5, 0.1
VARIANCE, MEMORY, TAIL, WAVELENGTH_M = 0.02, 2.0, 0.1, 0.8


def test_places_between_cells_lie_between_them() -> None:
    """Three places a cell along, every second cell across; nothing is known beside a cell that is not mapped."""
    rng = np.random.default_rng(4)
    coefficients, components = rng.normal(size=(6, 7, 5)), rng.normal(size=(5, KEPT))
    valid = np.ones((6, 7), bool)
    valid[4, 2] = False
    tile = Tile(
        jnp.asarray(coefficients, jnp.float32),
        jnp.asarray((coefficients**2).sum(axis=-1), jnp.float32),
        jnp.asarray(valid),
        jnp.zeros(2, jnp.float32),
        jnp.asarray([0.15, 0.05], jnp.float32),
    )
    made = lattice_ground(tile, jnp.asarray(components, jnp.float32), stride=(1, 2), finer=(3, 1), border=(2, 1))
    assert made.known.shape == (16 + 4, 4 + 2)
    inner = np.asarray(made.known)[2:-2, 1:-1]
    # Column 1 is that of the cell that is not mapped; from the cell before it to the one after, ends excluded.
    expected_known = np.ones((16, 4))
    expected_known[10:15, 1] = 0.0
    np.testing.assert_array_equal(inner, expected_known)
    assert np.asarray(made.known).sum() == inner.sum()
    at = np.arange(16) / 3.0
    for column in range(4):
        wanted = np.stack(
            [np.interp(at, np.arange(6), coefficients[:, 2 * column] @ each) for each in components.T], axis=0
        )
        wanted = wanted * expected_known[None, :, column]
        np.testing.assert_allclose(np.asarray(made.value)[:, 2:-2, column + 1], wanted, rtol=2e-5, atol=2e-5)
        np.testing.assert_allclose(
            np.asarray(made.power)[2:-2, column + 1], (wanted**2).sum(axis=0), rtol=2e-4, atol=2e-4
        )


def model() -> Model:
    one = jnp.float32
    return Model(
        likelihood=Likelihood(one(VARIANCE), one(MEMORY), one(TAIL)),
        step_m=jnp.asarray(STEP_M, jnp.float32),
        wavelength_m=one(WAVELENGTH_M),
        spacing_m=one(SPACING_M),
        apart=one(0.25),
        lost=one(LOST),
        foreign=one(FOREIGN),
        back=one(BACK),
        mixing=one(MIXING),
        neighbour=jnp.asarray(NEIGHBOUR, jnp.float32),
        whole=jnp.asarray(True),
    )


def some_ground(seed: int) -> LatticeGround:
    """Random components, smooth over a few places, with a hole."""
    rng = np.random.default_rng(seed)
    value = rng.normal(size=(KEPT, 40, 36))
    for axis in (1, 2):
        value = value + np.roll(value, 1, axis) + 0.5 * np.roll(value, 2, axis)
    known = np.ones((40, 36))
    known[:, 27:] = 0.0
    value = value * known
    return LatticeGround(*(jnp.asarray(field, jnp.float32) for field in (value, np.sum(value**2, axis=0), known)))


def a_stop(ground: LatticeGround, seed: int, place: tuple[float, float] | None, travel_m: float = 0.1) -> Stop:
    """Traces as the ground has them with its array's centre at a place (of no ground with None)."""
    rng = np.random.default_rng(seed)
    offset = np.stack([rng.uniform(-0.4, 0.4, CHANNELS), 2.2 * (1.5 - np.arange(CHANNELS))], axis=-1)
    live = rng.normal(size=(PLANES, CHANNELS, KEPT))
    if place is not None:
        true = np.stack([between(np.asarray(ground.value, float), *(np.array(place) + o)) for o in offset])
        live[1] = true + 0.7 * np.std(true) * rng.normal(size=true.shape)
    return Stop(
        jnp.asarray(live, jnp.float32),
        jnp.asarray([1.0, 1.0, 0.0, 1.0], jnp.float32),
        jnp.asarray([9.3, 8.8], jnp.float32),
        jnp.asarray(offset, jnp.float32),
        jnp.asarray(FACING, jnp.float32),
        jnp.float32(travel_m),
        jnp.asarray([0.03, 0.02], jnp.float32),
        jnp.float32(0.01),
        jnp.asarray(True),
    )


def between(field: np.ndarray, along: float, cross: float) -> np.ndarray:
    """Bilinear, of the last two axes."""
    i, j = int(np.floor(along)), int(np.floor(cross))
    u, v = along - i, cross - j
    near = (1 - u) * ((1 - v) * field[..., i, j] + v * field[..., i, j + 1])
    return np.asarray(near + u * ((1 - v) * field[..., i + 1, j] + v * field[..., i + 1, j + 1]))


def expected(state: FilterState, stop: Stop, ground: LatticeGround) -> tuple[np.ndarray, float, float]:
    """Mass, foreign and p_false after one step, place by place in double precision."""
    mass, foreign = np.asarray(state.mass, float), float(state.foreign)
    travel_m, valid = float(stop.travel_m), np.asarray(stop.valid, float)
    for axis, variance in ((2, float(stop.wander[0])), (3, float(stop.wander[1]))):
        before = mass.copy()
        size = mass.shape[axis]
        for at in range(size):
            for to in (at - 1, at + 1):
                inside = to if 0 <= to < size else at
                moved = 0.5 * variance * np.take(before, at, axis)
                index: list[Any] = [slice(None)] * 4
                index[axis] = inside
                mass[tuple(index)] += moved
                index[axis] = at
                mass[tuple(index)] -= moved
    mixing = min(MIXING * travel_m, 0.1)
    before = mass.copy()
    for one, other in np.argwhere(NEIGHBOUR > 0):
        mass[one] += mixing * before[other]
        mass[other] -= mixing * before[other]
    before = mass.copy()
    for one in range(len(RHOS)):
        for other in (one - 1, one + 1):
            if 0 <= other < len(RHOS):
                mass[:, other] += mixing * before[:, one]
                mass[:, one] -= mixing * before[:, one]
    leap = LOST * travel_m + float(stop.leap)
    places = SHAPE[0] * SHAPE[1]
    total = mass.sum()
    spread = mass.sum(axis=(2, 3), keepdims=True) / places
    returned = BACK * travel_m * foreign
    mass = (1 - FOREIGN * travel_m) * ((1 - leap) * mass + leap * spread) + returned / mass.size
    foreign = foreign - returned + FOREIGN * travel_m * total
    value, known = np.asarray(ground.value, float), np.asarray(ground.known, float)
    live, offset = np.asarray(stop.live, float), np.asarray(stop.offset, float)
    loud = (live**2).sum(axis=2)
    share = (loud * valid).mean(axis=0) / (loud * valid).mean(axis=0).sum()
    ratio = np.ones_like(mass)
    for i, j in np.ndindex(*SHAPE):
        place = np.asarray(stop.corner, float) + (i, j)
        on = np.array([v * (between(known, *(place + o)) > 0.999) for v, o in zip(valid, offset, strict=True)])
        cover = on.sum() / valid.sum()
        if cover < 0.3:
            continue
        under = np.stack([between(value, *(place + o)) for o in offset])
        # The map's power between places is the mean of theirs.
        below = sum(o * between((value**2).sum(axis=0), *(place + at)) for o, at in zip(on, offset, strict=True))
        for plane in range(PLANES):
            heard = (loud[plane] * valid).sum() * (share * on).sum()
            r = float((live[plane] * under * on[:, None]).sum() / np.sqrt(below * heard))
            numbers = cover * min(travel_m / SPACING_M, 1.0) / (MEMORY * max(VARIANCE, float(state.variance)))
            for k, rho in enumerate(RHOS):
                ratio[plane, k, i, j] = (1 - rho**2) ** (numbers / 2) / (1 - rho * min(r, 0.98)) ** numbers
    believed = (mass * ratio).sum() / mass.sum()
    mass = mass * ((1 - TAIL) * ratio + TAIL * believed)
    foreign = foreign * (1 - TAIL + TAIL * believed)
    whole = mass.sum() + foreign
    mass, foreign = mass / whole, foreign / whole
    there = mass.sum(axis=(0, 1))
    mode = np.array(np.unravel_index(np.argmax(there), SHAPE))
    # Ahead and aside of the mode, in the vehicle's heading.
    apart = np.array([(np.array(at) - mode) * STEP_M for at in np.ndindex(*SHAPE)])
    cos, sin = FACING
    ahead, aside = np.abs(apart @ [cos, sin]), np.abs(apart @ [-sin, cos])
    near = (ahead <= 0.3) & (aside <= 0.3)
    variance = np.average(aside[near] ** 2, weights=there.ravel()[near])
    reach = min(max(0.3, 4.0 * np.sqrt(variance)), max(0.3, 0.5 * WAVELENGTH_M))
    return mass, foreign, foreign + there.ravel()[(ahead > 0.3) | (aside > reach)].sum()


def led(state: FilterState, stops: list[Stop], ground: LatticeGround) -> tuple[FilterState, Posterior]:
    together = jax.tree.map(lambda *fields: jnp.stack(fields), *stops)
    after: tuple[FilterState, Posterior] = run(state, together, ground, model(), reach=REACH, crop=5)
    return after


@pytest.mark.parametrize("place", [None, (14.6, 13.2)])
def test_a_step_is_as_numpy_says(place: tuple[float, float] | None) -> None:
    """Twice, so that the second begins with a mass of any shape."""
    ground = some_ground(1)
    state = begin(PLANES, SHAPE, 0.5, VARIANCE)
    for seed in (2, 3):
        stop = a_stop(ground, seed, place)
        mass, foreign, p_false = expected(state, stop, ground)
        state, posterior = led(state, [stop], ground)
        np.testing.assert_allclose(np.asarray(state.mass), mass, rtol=3e-3, atol=1e-8)
        assert float(state.foreign) == pytest.approx(foreign, rel=3e-3)
        assert float(posterior.p_false[0]) == pytest.approx(p_false, rel=3e-3)


def test_stops_find_their_place_and_foreign_ones_do_not() -> None:
    ground = some_ground(4)
    _, posterior = led(
        begin(PLANES, SHAPE, 0.5, VARIANCE), [a_stop(ground, s, (15.3, 13.8)) for s in range(12)], ground
    )
    assert np.asarray(posterior.mode[-1]).tolist() == [6, 5]
    assert int(jnp.argmax(posterior.plane[-1])) == 1
    foreign = led(begin(PLANES, SHAPE, 0.5, VARIANCE), [a_stop(ground, s, None) for s in range(12)], ground)[1]
    assert float(foreign.p_false.min()) > 0.1
    assert float(posterior.p_false[-1]) < 0.05 < float(foreign.p_false[-1])


def test_mass_is_whole_and_standstill_adds_nothing() -> None:
    """Nor do stops that only fill a chunk."""
    ground = some_ground(5)
    before, _ = led(begin(PLANES, SHAPE, 0.5, VARIANCE), [a_stop(ground, 1, (15.3, 13.8))], ground)
    assert float(before.mass.sum() + before.foreign) == pytest.approx(1.0, abs=1e-5)
    still = a_stop(ground, 1, (15.3, 13.8), travel_m=0.0)._replace(wander=jnp.zeros(2), leap=jnp.float32(0.0))
    for stop in (still, a_stop(ground, 2, None)._replace(there=jnp.asarray(False))):
        after, _ = led(before, [stop] * 20, ground)
        np.testing.assert_allclose(np.asarray(after.mass), np.asarray(before.mass), rtol=1e-4, atol=1e-10)


def test_alone_and_in_chunks_stops_are_the_same() -> None:
    ground = some_ground(6)
    stops = [a_stop(ground, seed, (15.3, 13.8)) for seed in range(8)]
    together, posterior = led(begin(PLANES, SHAPE, 0.5, VARIANCE), stops, ground)
    state, p_false = begin(PLANES, SHAPE, 0.5, VARIANCE), []
    for stop in stops:
        state, one = led(state, [stop], ground)
        p_false.append(float(one.p_false[0]))
    np.testing.assert_allclose(np.asarray(state.mass), np.asarray(together.mass), rtol=1e-4, atol=1e-9)
    np.testing.assert_allclose(p_false, np.asarray(posterior.p_false), rtol=1e-4)


def test_a_drive_whose_ground_resembles_all_ground_is_believed_less() -> None:
    """By the places far from the mode, whose correlations are large, and stay from stop to stop."""
    rng, size = np.random.default_rng(8), (31, 29)
    stop = a_stop(some_ground(1), 1, None)
    ground = rng.normal(size=size)
    state = begin(1, size, 0.5, VARIANCE)
    summed, alone, variance = np.zeros(size), 0.0, VARIANCE
    for number in range(6):
        r = np.clip(0.25 * (0.8 * ground + 0.6 * rng.normal(size=size)), -0.7, 0.7)
        r[15, 14] = 0.8
        mass, foreign = np.asarray(state.mass, float), float(state.foreign)
        at = np.unravel_index(np.argmax(mass.sum(axis=(0, 1))), size)
        away_m = np.hypot(
            *np.meshgrid(*((np.arange(n) - a) * s for n, a, s in zip(size, at, STEP_M, strict=True)), indexing="ij")
        )
        far = away_m > WAVELENGTH_M
        summed, alone = 0.9375 * summed + r, 0.9375**2 * alone + np.mean(r[far] ** 2)
        memory = np.mean(summed[far] ** 2) / alone
        # Over the last two metres.
        variance += (1.0 - np.exp(-float(stop.travel_m) / 2.0)) * (np.mean(r[far] ** 2) - variance)
        if number:
            assert memory > 1.3
        numbers = 1.0 / (max(variance, VARIANCE) * max(memory, MEMORY))
        ratio = np.stack([(1 - q**2) ** (numbers / 2) / (1 - q * np.minimum(r, 0.98)) ** numbers for q in RHOS])[None]
        believed = (mass * ratio).sum() / mass.sum()
        mass = mass * ((1 - TAIL) * ratio + TAIL * believed)
        foreign = foreign * (1 - TAIL + TAIL * believed)
        surface = Surface(jnp.asarray(r[None], jnp.float32), jnp.ones(size, jnp.float32))
        state = weigh(state, surface, stop, model())
        assert float(state.foreign) == pytest.approx(foreign / (mass.sum() + foreign), rel=1e-3)
        np.testing.assert_allclose(np.asarray(state.mass), mass / (mass.sum() + foreign), rtol=5e-3, atol=1e-9)
    assert memory > MEMORY
    assert variance > 1.5 * VARIANCE
    assert float(state.variance) == pytest.approx(variance, rel=1e-3)
    # About a known place it is the place's own ground that stays from stop to stop.
    near = weigh(state, surface, stop, model()._replace(whole=jnp.asarray(False)))
    numbers = 1.0 / (max(float(state.variance), VARIANCE) * MEMORY)
    ratio = np.stack([(1 - q**2) ** (numbers / 2) / (1 - q * np.minimum(r, 0.98)) ** numbers for q in RHOS])[None]
    mass, foreign = np.asarray(state.mass, float), float(state.foreign)
    believed = (mass * ratio).sum() / mass.sum()
    foreign *= 1 - TAIL + TAIL * believed
    whole = foreign + (mass * ((1 - TAIL) * ratio + TAIL * believed)).sum()
    assert float(near.foreign) == pytest.approx(foreign / whole, rel=1e-3)


def test_gaussian_ground_has_a_short_tail_and_ground_with_stones_a_longer_one() -> None:
    rng = np.random.default_rng(7)
    gaussian = [0.1 * rng.normal(size=(32, 60)) for _ in range(160)]
    known = measure_likelihood(gaussian)
    assert float(known.variance) == pytest.approx(0.01, rel=0.05)
    assert 1.0 <= float(known.memory) < 1.25
    stones = [np.where(rng.uniform(size=each.shape) < 0.02, 0.8, each) for each in gaussian]
    assert measure_likelihood(stones).tail > known.tail


def test_the_fewer_stretches_a_map_has_the_less_a_stop_is_worth() -> None:
    rng = np.random.default_rng(8)
    grounds = [[0.2 * rng.normal(size=(16, 60)) for _ in range(60)] for _ in range(40)]
    few = [0, 1, 3, 12, 60]
    known = [[measure_likelihood(ground[:count]) for count in few] for ground in grounds]
    numbers = np.array([[1.0 / (each.variance * each.memory) for each in row] for row in known])
    assert np.all(np.diff(np.median(numbers, axis=0)) > 0.0)
    # Their stops hold 25.
    assert np.mean(numbers > 25.0) < 0.02
    assert np.median(numbers[:, -1]) > 15.0
    tails = np.array([[each.tail for each in row] for row in known])
    assert np.all(np.diff(tails, axis=1) <= 0.0)


# Drives of the canonical site.


def registered(site: Site, log: Path, causal: bool = False) -> RegisteredDrive:
    options = RegisterOptions(search_m=1.5, filter="causal" if causal else "smoothed")
    with MapFile.open(site.map) as source, DriveLog.open(log) as drive:
        return register_log(source, drive, options)


def judged(drive: RegisteredDrive) -> tuple[np.ndarray, np.ndarray]:
    """Which scans are ok, and how far off those are."""
    ok = drive.table["code"].to_numpy() == "ok"
    return ok, np.hypot(*true_errors(drive)[ok].T)


@pytest.mark.parametrize(("causal", "searching_m"), [(True, 0.06), (False, 0.3)])
def test_a_clear_day_is_located(site: Site, causal: bool, searching_m: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where the whole region is searched at a stop in several only, as short waves are."""
    monkeypatch.setattr("lgprjax.registration.bayes.drive._SEARCHING_M", searching_m)
    drive = registered(site, site.logs["live"], causal)
    ok, off_m = judged(drive)
    travel_m = np.abs(drive.track.travel_m - drive.track.travel_m[0])
    assert ok[travel_m > 4.0].mean() >= 0.98
    assert off_m.max() < 0.1
    if not causal:
        assert ok.mean() >= 0.98
        assert np.sqrt(np.mean(true_errors(drive)[ok] ** 2, axis=0)).max() < 0.04


def test_a_long_drive_is_joined_in_segments(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each with some of the stops that follow it."""
    whole = registered(site, site.logs["live"])
    monkeypatch.setattr("lgprjax.registration.bayes.smoothed.SEGMENT", 90)
    monkeypatch.setattr("lgprjax.registration.bayes.smoothed.LAG", 40)
    parts = registered(site, site.logs["live"])
    np.testing.assert_array_equal(parts.table["code"] == "ok", whole.table["code"] == "ok")
    both = np.asarray(parts.table["code"] == "ok")
    apart = np.asarray(parts.fix.pose)[both, :2] - np.asarray(whole.fix.pose)[both, :2]
    assert np.quantile(np.hypot(*apart.T), 0.9) < 0.01


@pytest.mark.parametrize("day", [pytest.param("snow", marks=pytest.mark.long), "rain"])
def test_snow_and_rain_are_located(site: Site, day: str, tmp_path: Path) -> None:
    drive = registered(site, drive_over(village(), tmp_path / f"{day}.drive.h5", WEATHER[day](7)))
    ok, off_m = judged(drive)
    assert ok.mean() >= 0.95
    assert off_m.max() < 0.15


@pytest.mark.parametrize("more", [["--causal"], []], ids=["causal", "smoothed"])
def test_other_ground_is_refused(site: Site, tmp_path: Path, more: list[str]) -> None:
    """On the way, and with what lies ahead, which the table tells."""
    with pytest.raises(SystemExit):
        main(["register", str(site.map), str(site.logs["impostor"]), "-o", str(tmp_path), "--search", "filter", *more])
    table = read_fixes(tmp_path / "impostor.fixes.csv")
    assert not (table["code"] == "ok").any()
    assert float(table["p_false"].min()) > 1e-2
    assert ("smoothed" in table) == (not more)


@pytest.mark.parametrize("chords", [False, True], ids=["odometer", "positions"])
def test_no_fix_is_wrong_where_positions_jump(site: Site, chords: bool) -> None:
    """By 1.5 m over 8 m; travel from the odometer, or as the length of the line through the positions."""

    def led_to(track: Track) -> Track:
        pose, travel_m = track.pose.copy(), track.travel_m
        jumped = np.abs(np.abs(travel_m - travel_m[0]) - 12.0) < 4.0
        pose[jumped, :2] += 1.5
        if chords:
            # What is left of a jump once travel has been mended: some decimetres, at both ends.
            travel_m = travel_m + 0.3 * np.cumsum(np.diff(jumped.astype(float), prepend=0.0) != 0.0)
        return track._replace(pose=pose, travel_m=travel_m)

    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        for options in (RegisterOptions(filter="causal"), RegisterOptions(filter="smoothed")):
            drive = register_log(source, log, options, led_to=led_to)
            ok, off_m = judged(drive)
            assert off_m.max() < 0.3
            assert ok.mean() > 0.8


def test_beside_the_map_fixes_are_not_drawn_onto_it(site: Site, tmp_path: Path) -> None:
    """Half of the array beyond the outermost line; and where the way back leaves the map."""
    drives = [
        registered(site, drive_over(village(), tmp_path / "beside.drive.h5", WEATHER["clear"](11), lane_m=1.0)),
        registered(site, drive_over(village(), tmp_path / "back.drive.h5", WEATHER["clear"](7), direction=-1)),
    ]
    for drive in drives:
        ok, off_m = judged(drive)
        assert ok.mean() > 0.5
        assert off_m.max() < 0.15


def test_few_channels_are_located(site: Site, tmp_path: Path) -> None:
    """Two of the array's, the rest silent: fewer independent numbers, and more travel."""
    import h5py

    path = tmp_path / "two.drive.h5"
    path.write_bytes(site.logs["live"].read_bytes())
    with h5py.File(path, "r+") as store:
        traces = store["radar/traces"]
        kept = [traces.shape[1] // 2 - 1, traces.shape[1] // 2 + 1]
        silent = [channel for channel in range(traces.shape[1]) if channel not in kept]
        whole = traces[:]
        whole[:, silent] = 0
        traces[:] = whole
    drive = registered(site, path)
    ok, off_m = judged(drive)
    assert ok.mean() > 0.5
    assert off_m.max() < 0.3


# Headings that are not as stated.


def bend(rng: np.random.Generator, length_m: float = 8.0) -> np.ndarray:
    """A path of constant curvature, any direction."""
    at_m = np.arange(0.0, length_m, rng.uniform(0.03, 0.15))
    yaw = rng.uniform(-np.pi, np.pi) + at_m * rng.uniform(-0.1, 0.1)
    step_m = np.gradient(at_m)
    return np.stack([np.cumsum(np.cos(yaw) * step_m), np.cumsum(np.sin(yaw) * step_m)], axis=1)


def seen(rng: np.random.Generator, path_m: np.ndarray, turn_deg: float) -> np.ndarray:
    """Places of a vehicle whose heading is off, with odometry's wander and errors of places alike over half a metre."""
    steps_m = np.diff(path_m, axis=0, prepend=path_m[:1])
    wander_m = 0.01 * np.sqrt(np.hypot(*steps_m.T))[:, None] * rng.normal(size=path_m.shape)
    turn = np.exp(1j * np.radians(turn_deg)) * (steps_m @ [1.0, 1j])
    place_m = np.stack([turn.real, turn.imag], axis=1).cumsum(axis=0) + wander_m.cumsum(axis=0)
    alike = max(1, round(0.5 * len(path_m) / 8.0))
    noise_m = np.repeat(rng.normal(size=(len(path_m) // alike + 1, 2)), alike, axis=0)[: len(path_m)]
    return np.asarray(place_m + rng.uniform(0.0, 0.03) * noise_m + rng.uniform(-50.0, 50.0, 2))


@pytest.mark.parametrize(("off_deg", "least", "most"), [(0.3, 0.0, 0.005), (2.0, 0.0, 0.1), (6.0, 0.9, 1.0)])
def test_a_heading_off_by_more_than_stated_is_measured(off_deg: float, least: float, most: float) -> None:
    rng = np.random.default_rng(8)
    found = []
    for _ in range(400):
        path_m = bend(rng)
        true_deg = off_deg * rng.choice([-1.0, 1.0])
        turn_rad, sigma_rad = turn_between(path_m, seen(rng, path_m, true_deg), np.radians(0.3))
        found.append((turn_rad != 0.0, abs(turn_rad - np.radians(true_deg)) < 3.0 * sigma_rad))
    turned, right = np.array(found).T
    assert least <= turned.mean() <= most
    assert np.sum(turned & ~right) <= 0.05 * len(turned)


def test_a_corrected_path_has_no_steps() -> None:
    """A heading off by 10°: from some metres on, the corrected path runs beside the true one; changes of the turn begin
    at the stop that brought them.
    """
    rng = np.random.default_rng(9)
    path_m = bend(rng, 20.0)
    place_m = seen(rng, path_m, 10.0)
    travel_m = np.cumsum(np.hypot(*np.diff(path_m, axis=0, prepend=path_m[:1]).T))
    known, corrected_m = HeadingError(), np.zeros_like(path_m)
    for low in range(0, len(path_m), 8):
        own = slice(low, low + 8)
        corrected_m[own] = known.corrected_m(path_m[own])
        known.hear(travel_m[own], path_m[own], place_m[own], np.full(len(path_m[own]), 1e-3), np.radians(0.3))
    steps_m = np.hypot(*np.diff(corrected_m, axis=0).T)
    np.testing.assert_allclose(steps_m, np.hypot(*np.diff(path_m, axis=0).T), atol=1e-9)
    late = travel_m > 8.0
    drift_m = (corrected_m - place_m)[late]
    assert np.ptp(drift_m, axis=0).max() < 0.5 < 12.0 * np.radians(10.0)
    assert known.used


@pytest.mark.parametrize(
    ("heading_deg", "height_m", "causal"),
    [(-9.0, 0.0, True), pytest.param(-9.0, 0.0, False, marks=pytest.mark.long), (0.0, 0.25, True)],
)
def test_attitudes_that_are_wrong_and_sure_are_found(
    site: Site, heading_deg: float, height_m: float, causal: bool
) -> None:
    """A heading stated to 0.3°; a height beyond what is searched at first, which no time scale can stand for."""

    def led_to(track: Track) -> Track:
        pose = track.pose.copy()
        pose[:, 2:4] += np.array([height_m, np.radians(heading_deg)])
        return track._replace(pose=pose, sigma_yaw_rad=np.full(len(pose), np.radians(0.3)))

    scale = 1.0 if height_m else None
    options = RegisterOptions(search_m=1.5, filter="causal" if causal else "smoothed", time_scale=scale)
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        drive = register_log(source, log, options, led_to=led_to)
    ok, off_m = judged(drive)
    assert off_m.max() < 0.3
    assert drive.truth is not None
    after = np.abs(drive.track.travel_m - drive.track.travel_m[0]) > 6.0
    assert ok[after].mean() > 0.8
    late = ok & after
    off_rad = np.asarray(drive.fix.pose)[late, 3] - drive.truth[late, 3]
    off_rad = np.mod(off_rad + np.pi, 2.0 * np.pi) - np.pi
    assert np.sqrt(np.mean(off_rad**2)) < np.radians(2.0)
