"""The public interface: the session of docs/api.md, an example of every name, kernels under jit, vmap and grad."""

import contextlib
import inspect
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import jax
import jax.numpy as jnp
import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib import pyplot
from matplotlib.axes import Axes

import lgprjax as lx
from canon.map import built_with_many_grounds
from canon.site import Site
from canon.trench import first_scans
from frozen.recordings import lay_out
from lgprjax.api.inputs import whole_number
from lgprjax.api.maps import Map
from lgprjax.api.matching import Batch
from lgprjax.api.page import api_page, examples
from lgprjax.api.vehicles import Vehicle
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.pso import SwarmResult
from lgprjax.recordings.drives import RecordedBlock, TraceDrive
from lgprjax.report import WRONG_M
from lgprjax.tuning.look_ahead import TrialCourses, TunedVehicle, sweep_look_ahead
from lgprjax.vehicle import line_course
from refusals import refusal_in, refused
from shown_commands import python_of

_ROOT = Path(__file__).parents[1]
_PAGE = _ROOT / "docs" / "api.md"
_SESSION = """
import jax

many = lx.register_many(site, [drives["impostor"], drives["live"]], "out/", workers=1)

windows = {"scans": slice(200, 700, 100), "window_m": 1.0}
batch = site.batch(drives["live"], **windows)                     # arrays on the device: tile, scans, priors
poses = jax.jit(lx.match)(batch)                                  # the kernel, vmappable
vehicle = lx.open_vehicle("made_up.vehicle.toml")
course = lx.course("offset", metres=3.0)
cost, slope = jax.value_and_grad(lx.tracking_cost)(3.0, vehicle, course)
tuned = lx.tune("tuning/k_ratio.toml").vehicle
"""


@pytest.fixture(autouse=True)
def _pictures() -> Iterator[None]:
    mpl.use("agg")
    yield
    pyplot.close("all")


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The folder in which the session was typed, and its names."""
    folder = tmp_path_factory.mktemp("session")
    shutil.copytree(_ROOT / "tuning", folder / "tuning")
    for name in ("made_up.vehicle.toml", "made_up_flail.vehicle.toml", "field.geojson"):
        shutil.copyfile(_ROOT / "onboard" / name, folder / name)
    lay_out("field", folder / "field")
    # The village with 40 m of its road, which is the site of other tests: a file of that name goes before the example.
    village = (_ROOT / "sites" / "village.toml").read_text(encoding="utf-8")
    for key, whole, part in (("length_m", 70, 40), ("stop_m", 65, 35), ("stop_m", 60, 30)):
        assert f"{key} = {whole}\n" in village
        village = village.replace(f"{key} = {whole}\n", f"{key} = {part}\n")
    (folder / "village").write_text(village, encoding="utf-8")
    scope: dict[str, Any] = {}
    with contextlib.chdir(folder), built_with_many_grounds():
        lx.simulate("tuning/drives.toml", "out/drives", only=["palm_tree", "palm_tree_again"])
        exec("\n".join([*python_of(_PAGE), _SESSION]), scope)
    return folder, scope


def test_a_session_runs_as_it_stands(session: tuple[Path, dict[str, Any]]) -> None:
    _, names = session
    fixes, many, poses = names["fixes"], names["many"], names["poses"]
    assert isinstance(fixes.table, pd.DataFrame)
    assert len(names["located"]) == fixes.ok.sum()
    assert fixes.ok.mean() > 0.5
    off = np.hypot(*(fixes.fix.pose - fixes.truth)[fixes.ok, :2].T)
    assert np.percentile(off, 99.0) < 0.1
    assert off.max() < WRONG_M
    assert fixes.summary.wrong_ok == 0
    assert set(many) == {"impostor", "live"}
    assert not many.failed
    pd.testing.assert_series_equal(many["live"]["code"], fixes.table["code"], check_index=False, check_dtype=False)
    assert not (many["impostor"]["code"] == "ok").any()
    located = np.asarray(poses.code) == lx.Code.OK
    assert located.any()
    assert np.hypot(*(poses.pose - fixes.truth[200:700:100])[located, :2].T).max() < 0.2
    assert np.isfinite(names["cost"])
    assert np.isfinite(names["slope"])
    assert names["tuned"].file.steering.rear_ratio == pytest.approx(0.63, abs=0.01)


@pytest.mark.parametrize(("name", "text"), list(examples()), ids=[name for name, _ in examples()])
def test_every_name_has_an_example_that_runs(
    session: tuple[Path, dict[str, Any]], monkeypatch: pytest.MonkeyPatch, name: str, text: str
) -> None:
    monkeypatch.chdir(session[0])
    assert f"{name}(" in text or f"lx.{name}" in text
    exec(text, {"lx": lx})


def test_one_name_or_log_is_several_of_one(tmp_path: Path) -> None:
    drives = lx.simulate(_ROOT / "tuning" / "drives.toml", tmp_path, only="straight")
    assert list(drives) == ["straight"]
    tuned = lx.tune("straight", vehicle=_ROOT / "tuning" / "made_up.vehicle.toml", logs=drives["straight"])
    assert repr(tuned).startswith("Tuned 'straight'")


def test_a_study_file_takes_no_logs_or_options_beside_it(tmp_path: Path) -> None:
    with refused("logs, degree", "vehicle"):
        lx.tune(_ROOT / "tuning" / "k_ratio.toml", logs=[tmp_path / "none"], degree=3)


def test_the_page_lists_the_public_names() -> None:
    page = _PAGE.read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == lx.__all__
    assert len(page.split()) <= 600


def test_the_reference_has_every_name_with_its_example() -> None:
    page = api_page()
    assert re.findall(r"^## (\w+)$", page, re.MULTILINE) == lx.__all__
    assert "tune(study, *, vehicle=None, logs=(), held_out=(), **options)" in page
    assert all(text.strip() in page for _, text in examples())


def test_the_import_costs_nothing() -> None:
    code = (
        "import sys, time; began = time.perf_counter(); import lgprjax; took = time.perf_counter() - began; "
        "heavy = {'jax', 'numpy', 'h5py', 'pandas', 'matplotlib'} & set(sys.modules); "
        "assert set(lgprjax.__all__) <= set(dir(lgprjax)); print(took, *heavy)"
    )
    told = [
        subprocess.run(
            [sys.executable, "-c", code], cwd=_ROOT, capture_output=True, text=True, check=True, timeout=60
        ).stdout.split()
        for _ in range(3)
    ]
    assert {name for _, *heavy in told for name in heavy} == set()
    # The least of three: what else the machine does is not the import's.
    assert min(float(took) for took, *_ in told) <= 0.1
    with pytest.raises(AttributeError, match="nothing_of_the_kind"):
        _ = lx.nothing_of_the_kind  # type: ignore[attr-defined]


def test_names_for_the_type_checker_are_those_that_are_loaded() -> None:
    text = (_ROOT / "lgprjax" / "__init__.py").read_text(encoding="utf-8")
    for name in lx.__all__:
        loaded = getattr(lx, name)
        assert f"from {lx._MODULE_OF[name]} import {name} as {name}" in text
        assert inspect.getdoc(loaded)
    assert set(lx._MODULE_OF) == set(lx.__all__)


@pytest.fixture(scope="module")
def opened(site: Site) -> Iterator[Map]:
    """The map of the session's site."""
    with lx.open_map(site.map) as opened:
        yield opened


@pytest.fixture(scope="module")
def batch(site: Site, opened: Map) -> Batch:
    """Some scans of the live drive; of the same shape as those of the example, so that programs are shared."""
    return opened.batch(site.logs["live"], scans=slice(200, 700, 100))


def test_match_gives_the_same_under_jit_and_vmap(batch: Batch) -> None:
    plain = lx.match(batch)
    assert np.isfinite(plain.pose).all()
    jitted = jax.jit(lx.match)(batch)
    np.testing.assert_allclose(jitted.pose, plain.pose, atol=1e-4)
    twice: Batch = jax.tree.map(lambda field: jnp.stack([field, field]), batch)
    for row in jax.vmap(lx.match)(twice).pose:
        np.testing.assert_allclose(row, plain.pose, atol=1e-3)


def test_a_window_locates_what_a_scan_does_not(site: Site, opened: Map, batch: Batch) -> None:
    windows = opened.batch(site.logs["live"], scans=slice(200, 700, 100), window_m=1.0)
    assert windows.scans.valid.shape == (5, 99)
    fix = lx.match(windows)
    np.testing.assert_allclose(fix.window_m, 1.0)
    assert np.count_nonzero(fix.code == lx.Code.OK) > np.count_nonzero(lx.match(batch).code == lx.Code.OK)


def test_one_scan_is_matched_as_among_others(batch: Batch) -> None:
    rows = (batch.scans, batch.prior, batch.half_width, batch.finite)
    alone = batch._replace(
        **dict(zip(("scans", "prior", "half_width", "finite"), jax.tree.map(lambda f: f[2:3], rows), strict=True))
    )
    np.testing.assert_allclose(lx.match(alone).pose[0], lx.match(batch).pose[2], atol=1e-4)


def test_gradients_of_a_match_are_what_it_does(batch: Batch) -> None:
    coefficients = batch.scans.coefficients
    rng = np.random.default_rng(0)
    way = jnp.asarray(rng.normal(size=coefficients.shape), jnp.float32) * jnp.std(coefficients)

    @jax.jit
    def along(amount: jax.Array) -> tuple[jax.Array, jax.Array]:
        fix = lx.match(batch._replace(scans=batch.scans._replace(coefficients=coefficients + amount * way)))
        return jnp.asarray(fix.correlation), jnp.asarray(fix.pose)

    _, (slope, moves) = jax.jvp(along, (jnp.float32(0.0),), (jnp.float32(1.0),))
    step = 0.02
    high, low = along(jnp.float32(step)), along(jnp.float32(-step))
    np.testing.assert_allclose(slope, (high[0] - low[0]) / (2 * step), atol=4e-3)
    # The curvature is Gauss-Newton's: right to a third, across and in height, where a single scan is sharp.
    moved = np.asarray((high[1] - low[1]) / (2 * step))
    for axis in (1, 2):
        assert np.corrcoef(np.asarray(moves)[:, axis], moved[:, axis])[0, 1] > 0.9
    np.testing.assert_allclose(np.asarray(moves)[:, 1], moved[:, 1], atol=0.006)
    mean = jax.grad(
        lambda c: jnp.mean(lx.match(batch._replace(scans=batch.scans._replace(coefficients=c))).correlation)
    )
    np.testing.assert_allclose(jnp.sum(mean(coefficients) * way), jnp.mean(slope), rtol=1e-3, atol=1e-6)


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    """A vehicle whose file tells all that a rollout needs."""
    return lx.open_vehicle(_ROOT / "onboard" / "made_up.vehicle.toml")


def test_a_swarm_under_jit_vmap_and_grad() -> None:
    keys = jax.random.split(jax.random.key(1), 9)
    start = jax.random.uniform(keys[0], (24, 2), minval=-1.0, maxval=1.0)
    config = lx.SwarmConfig(particles=24, iterations=40)

    def highest(key: jax.Array, tilt: jax.Array) -> SwarmResult:
        """Of a hill under a slope: its summit is at 0.3 + tilt / 8, and 1 + 0.3 tilt + tilt^2 / 16 high."""

        def hill(places: jax.Array) -> jax.Array:
            return 1.0 + tilt * places[:, 0] - 4.0 * jnp.sum((places - 0.3) ** 2, axis=1)

        return lx.run_swarm(key, start, hill, jnp.ones(2, bool), config=config)

    tilt = jnp.float32(0.8)
    single = jax.jit(highest)(keys[1], tilt)
    np.testing.assert_allclose(single.position, [0.4, 0.3], atol=2e-3)
    np.testing.assert_allclose(single.score, 1.0 + 0.3 * 0.8 + 0.8**2 / 16, atol=1e-4)
    many = jax.vmap(highest, in_axes=(0, None))(keys[1:], tilt)
    np.testing.assert_allclose(many.position[0], single.position, atol=1e-6)
    np.testing.assert_allclose(many.score, single.score, atol=1e-4)
    slope = jax.grad(lambda tilt: highest(keys[1], tilt).score)(tilt)
    np.testing.assert_allclose(slope, 0.3 + 0.8 / 8, atol=2e-3)


def test_the_cost_is_that_of_the_look_ahead_study(vehicle: Vehicle) -> None:
    assert vehicle.chassis is not None
    assert vehicle.servo is not None
    trials = TrialCourses((line_course(100.0),), (2.235,), offsets_m=(3.0,), duration_s=10.0, longest_delay_s=0.1)
    tuned = TunedVehicle(vehicle.chassis, vehicle.servo, vehicle.servo.nominal_v)
    judged = sweep_look_ahead(tuned, trials, [2.0, 3.0, 5.0])
    cost = partial(lx.tracking_cost, duration_s=10.0)
    found = jax.vmap(cost, in_axes=(0, None, None))(
        jnp.array([2.0, 3.0, 5.0]), vehicle, lx.course("offset", metres=3.0)
    )
    np.testing.assert_allclose(found, judged.cost_m[:, 0], rtol=1e-4)


def test_the_cost_has_a_gradient_and_takes_plain_numbers(vehicle: Vehicle) -> None:
    course, cost = lx.course("offset", metres=3.0), jax.jit(partial(lx.tracking_cost, duration_s=10.0))
    value, slope = jax.value_and_grad(cost)(3.0, vehicle, course)
    assert float(value) == pytest.approx(float(cost(jnp.float32(3.0), vehicle, course)))
    about = (cost(3.05, vehicle, course) - cost(2.95, vehicle, course)) / 0.1
    assert float(slope) == pytest.approx(float(about), rel=0.05)


def test_a_rollout_under_jit_vmap_and_grad(vehicle: Vehicle) -> None:
    bend = lx.course("arc", radius_m=15.0)
    drive = jax.jit(partial(lx.rollout, duration_s=10.0))
    single = drive(vehicle, bend, 3.0)
    assert isinstance(single.plot(), Axes)
    many = jax.vmap(lambda metres: drive(vehicle, bend, metres))(jnp.array([2.0, 3.0]))
    assert many.trace.x_m.shape == (2, 200)
    np.testing.assert_allclose(many.metrics.rms_m[1], single.metrics.rms_m, rtol=1e-4)
    together = drive(vehicle, bend, jnp.array([2.0, 3.0]))
    np.testing.assert_allclose(together.metrics.rms_m, many.metrics.rms_m, rtol=1e-4)
    for several in (many, together):
        assert repr(several) == "Rollout: 200 steps of 2 vehicles"
        _, *lines = several.plot().lines
        np.testing.assert_allclose(lines[1].get_xydata(), single.plot().lines[1].get_xydata(), atol=1e-3)
    slope = jax.grad(lambda metres: drive(vehicle, bend, metres).metrics.rms_m)(3.0)
    assert np.isfinite(slope)
    assert slope != 0.0
    own = drive(vehicle, bend)
    assert float(own.metrics.rms_m) != float(single.metrics.rms_m)


def test_a_batch_of_courses_says_so_and_is_drawn() -> None:
    batch = jax.tree.map(lambda field: jnp.stack([field, field]), lx.course("offset"))
    assert repr(batch) == "Course 'offset': a batch of 2"
    assert len(batch.plot().lines) == 2


def test_numbers_of_numpy_are_numbers(vehicle: Vehicle) -> None:
    course = lx.course("offset", metres=np.float32(2.0), length_m=np.int64(50))  # type: ignore[arg-type]
    assert repr(course) == "Course 'offset': 50.0 m, begun 2 m to the left"
    drive = lx.rollout(vehicle, lx.course("line"), 3.0, duration_s=np.int64(1), step_s=np.float64(0.05))  # type: ignore[arg-type]
    assert drive.trace.x_m.shape == (20,)
    assert whole_number("workers", np.int64(2)) == 2


def test_traces_come_in_the_order_of_the_slice(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lgprjax.api.drives._BLOCK_SCANS", 64)
    drive, starts = lx.open_drive(site.logs["live"]), list[int]()
    blocks = TraceDrive.blocks

    def noted(self: TraceDrive, scans: int, start: int = 0) -> Iterator[RecordedBlock]:
        starts.append(start)
        return blocks(self, scans, start)

    monkeypatch.setattr(TraceDrive, "blocks", noted)
    whole = drive.traces(slice(0, 300))
    np.testing.assert_array_equal(drive.traces(slice(299, None, -3)), whole[299::-3])
    np.testing.assert_array_equal(drive.traces(slice(200, 300)), whole[200:])
    assert starts == [0, 2, 200]
    assert drive.traces(slice(5, 5)).shape == (0, *whole.shape[1:])


def test_a_map_is_sliced_at_the_time_asked_for(site: Site) -> None:
    assert lx.view(site.map, travel_time_ns=7.3).get_title().startswith("Map site: 7.3 ns, ")


def test_a_clean_file_has_a_table_of_findings_without_rows(site: Site) -> None:
    table = lx.check(site.map).table
    assert list(table.columns) == ["file", "place", "expected", "found", "severity"]
    assert not len(table)


def test_fixes_have_no_channel_to_zoom_into(session: tuple[Path, dict[str, Any]]) -> None:
    with refused("channel, raw, velocity_m_per_ns"):
        lx.zoom(session[1]["fixes"], channel=1)


def test_axes_of_ones_own_are_drawn_on(session: tuple[Path, dict[str, Any]], opened: Map, site: Site) -> None:
    _, names = session
    drive, fixes = lx.open_drive(site.logs["live"]), names["fixes"]
    for draw in (
        drive.plot,
        opened.plot,
        fixes.plot,
        names["course"].plot,
        partial(lx.view, opened),
        partial(lx.view, site.logs["live"], raw=True),
    ):
        _, ax = pyplot.subplots()
        drawn = draw(ax=ax)
        assert drawn is ax
        assert drawn.has_data()
        assert drawn.get_xlabel()


def test_reprs_say_what_things_are(session: tuple[Path, dict[str, Any]], batch: Batch, vehicle: Vehicle) -> None:
    _, names = session
    drive, site = names["drives"]["live"], names["site"]
    assert repr(drive).startswith(f"Drive 'live': {drive.scans} scans of 11 channels, 25.")
    assert repr(site).startswith(f"Map 'site': {site.stations} stations of 11 channels on 2 baselines, ")
    told = names["fixes"].summary
    assert repr(names["fixes"]).startswith(f"Fixes of 'live' on 'site': {told.scans} scans, {told.ok} of {told.tried} ")
    assert repr(names["many"]).startswith("ManyFixes: 2 drives, ")
    assert repr(batch) == "Batch: 5 scans of 11 traces with 46 coefficients on a tile of 832 x 56 cells"
    assert repr(vehicle).startswith(
        "Vehicle 'made-up vehicle on board': counter-steer, serial number SIM-1, wheelbase 3.8 m"
    )
    assert repr(names["course"]) == "Course 'offset': 100.0 m, begun 3 m to the left"


def test_a_drive_that_cannot_be_read_is_among_the_failed(site: Site, tmp_path: Path) -> None:
    broken = tmp_path / "broken.drive.h5"
    broken.write_bytes(site.logs["live"].read_bytes()[:5000])
    many = lx.register_many(site.map, [broken, tmp_path / "none.drive.h5"], tmp_path / "out")
    assert not list(many)
    assert set(many.failed) == {"broken", "none"}
    assert f"{broken}: file: " in many.failed["broken"]
    assert repr(many) == f"ManyFixes: 0 drives, 2 failed ({tmp_path / 'out'})"


def test_fixes_are_saved_as_the_command_line_does(session: tuple[Path, dict[str, Any]], tmp_path: Path) -> None:
    saved = session[1]["fixes"].save(tmp_path / "saved")
    assert lx.check(saved).ok
    assert lx.check(saved.with_name("live.fixes.h5")).ok
    with refused("output", "force=True"):
        session[1]["fixes"].save(tmp_path / "saved")
    (tmp_path / "file").write_bytes(b"")
    with refused("file"):
        session[1]["fixes"].save(tmp_path / "file" / "folder")


def test_fixes_of_a_file_that_was_replaced_are_not_saved(site: Site, tmp_path: Path) -> None:
    copy, other = tmp_path / "site.map.h5", tmp_path / "other.map.h5"
    shutil.copyfile(site.map, copy)
    shutil.copyfile(site.map, other)
    with h5py.File(other, "r+") as store:
        store["chance"].attrs["pieces"] = 17.0
    with lx.open_map(copy) as opened:
        before = opened.sha256
        short = first_scans(site.logs["live"], tmp_path / "short.drive.h5", 120)
        fixes = lx.register(opened, short, options=lx.RegisterOptions(search_m=1.5, window_m=0.0))
    copy.unlink()
    shutil.copyfile(other, copy)
    with refused(file=copy):
        fixes.save(tmp_path / "saved")
    assert not (tmp_path / "saved").exists()
    with lx.open_map(copy) as opened:
        copy.unlink()
        shutil.copyfile(site.map, copy)
        with refused(file=copy):
            _ = opened.sha256
    assert before == file_hash(copy)


def _closed(path: Path) -> Map:
    with lx.open_map(path) as opened:
        return opened


def _options(**values: object) -> lx.RegisterOptions:
    """Options as a notebook may give them, where no one checks types; here the tests' own check would refuse them."""
    options = lx.RegisterOptions()
    for name, value in values.items():
        object.__setattr__(options, name, value)
    return options


def _calls(folder: Path, site: Site) -> dict[str, tuple[Any, str]]:
    """Calls that are refused: file (``call`` for an argument), place and values that are named; empty where any do."""
    vehicle = _ROOT / "onboard" / "made_up.vehicle.toml"
    flail = _ROOT / "onboard" / "made_up_flail.vehicle.toml"
    live = site.logs["live"]
    return {
        "no file": (lambda: lx.open_drive(folder / "none.drive.h5"), "none.drive.h5: file: "),
        "no path": (
            lambda: lx.open_drive(3),  # type: ignore[arg-type]
            "call: drive: 3",
        ),
        "another file": (lambda: lx.open_map(live), "live.drive.h5: : "),
        "no site": (lambda: lx.simulate("vilage", folder), "vilage: site: array_sweeps"),
        "no drive of it": (lambda: lx.simulate("village", folder, only=["x"]), "village.toml: only: "),
        "no drives": (lambda: lx.build_map([], folder / "m.map.h5"), "call: drive: "),
        "a frequency": (
            lambda: lx.build_map(live, folder / "m.map.h5", centre_frequency_mhz=0.1),
            ": centre_frequency_mhz: ",
        ),
        "a map that is there": (lambda: lx.build_map(live, site.map), ": : force=True"),
        "a search": (
            lambda: lx.register(site.map, live, options=lx.RegisterOptions(search_m=-1.0)),
            "call: search_m: -1",
        ),
        "a map over its drive": (lambda: lx.build_map(live, live, force=True), "live.drive.h5: output: "),
        "a map over itself": (lambda: lx.open_map(site.map).refine(site.map, force=True), "site.map.h5: output: "),
        "half a seed": (
            lambda: lx.register(site.map, live, options=_options(seed=0.5)),
            "call: seed: 0, 2.14748e+09, 0.5",
        ),
        "a swarm of three": (lambda: lx.register(site.map, live, options=_options(swarm=3)), "call: swarm: 3"),
        "a word for a risk": (lambda: lx.register(site.map, live, options=_options(risk="low")), "call: risk: 'low'"),
        "sides that are numbers": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, sides=[1]),  # type: ignore[list-item]
            "call: sides: ",
        ),
        "an outage without a confidence": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, drop_out_s=30.0),
            "call: drop_out_s: 30",
        ),
        "no clearance": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, clearance_m=None),  # type: ignore[arg-type]
            "call: clearance_m: ",
        ),
        "no options": (
            lambda: lx.register(site.map, live, options=2.5),  # type: ignore[arg-type]
            "call: options: ",
        ),
        "two crews": (
            lambda: lx.register_many(site.map, [live], folder / "out", workers=1, scheduler="tcp://x:1"),
            ": workers, scheduler: ",
        ),
        "no scans": (lambda: lx.open_map(site.map).batch(live, slice(9, 9)), ": scans: "),
        "a window": (lambda: lx.open_map(site.map).batch(live, slice(9), window_m=-1.0), ": window_m: 0, 30"),
        "a channel": (lambda: lx.view(live, channel=11), "live.drive.h5: channel: 0, 10, 11"),
        "a speed": (lambda: lx.view(live, velocity_m_per_ns=1.0), "call: velocity_m_per_ns: 0"),
        "a kind": (
            lambda: lx.course("spiral"),  # type: ignore[arg-type]
            "course: kind: ",
        ),
        "an argument": (lambda: lx.course("line", radius_m=3.0), "course: radius_m: 'line'"),
        "a radius": (lambda: lx.course("arc", radius_m=0.1), "course: radius: 0.5, 0.1"),
        "a skid-steer one": (
            lambda: lx.rollout(lx.open_vehicle(flail), lx.course("line"), 3.0),
            "made_up_flail.vehicle.toml: steering_kind: counter_steer",
        ),
        "a counter-steered one": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", vehicle),
            ": steering_kind: ",
        ),
        "an overlap": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, overlap=1.0),
            ": overlap: 0, 1",
        ),
        "a duration": (
            lambda: lx.tracking_cost(3.0, lx.open_vehicle(vehicle), lx.course("line"), duration_s=0.0),
            "call: duration_s: ",
        ),
        "no vehicle": (
            lambda: lx.tracking_cost(3.0, vehicle, lx.course("line")),  # type: ignore[arg-type]
            "call: vehicle: open_vehicle()",
        ),
        "a folder": (lambda: lx.open_drive(folder), ": file: "),
        "a map for a drive": (lambda: lx.register(site.map, site.map), "site.map.h5: : "),
        "a drive for a map": (lambda: lx.register(live, live), "live.drive.h5: : "),
        "several for one": (
            lambda: lx.register(site.map, [live]),  # type: ignore[arg-type]
            "call: drive: ",
        ),
        "a table for a study": (lambda: lx.tune(_ROOT / "onboard" / "field.geojson"), "field.geojson: : "),
        "a table for a site": (lambda: lx.simulate(_ROOT / "README.md", folder), "README.md: file: "),
        "one scan": (
            lambda: lx.open_drive(live).traces(3),  # type: ignore[arg-type]
            "call: scans: slice(0, 512), 3",
        ),
        "half a channel": (
            lambda: lx.view(live, channel=1.5),  # type: ignore[arg-type]
            "call: channel: 1.5",
        ),
        "a map to zoom": (lambda: lx.zoom(site.map), "site.map.h5: file: "),
        "no axes": (
            lambda: lx.view(live, ax="x"),  # type: ignore[arg-type]
            "call: ax: 'x'",
        ),
        "a word for a number": (
            lambda: lx.view(live, velocity_m_per_ns="x"),  # type: ignore[arg-type]
            "call: velocity_m_per_ns: 'x'",
        ),
        "half a worker": (
            lambda: lx.register_many(site.map, [live], folder / "out", workers=1.5),  # type: ignore[arg-type]
            "call: workers: 1.5",
        ),
        "a closed map": (lambda: _closed(site.map).batch(live), "site.map.h5: file: "),
        "a closed map's plot": (lambda: lx.register(_closed(site.map), live), ": : "),
        "points of one": (
            lambda: lx.course([[0.0, 0.0], [1.0]]),  # type: ignore[arg-type]
            "course: points: 2]",
        ),
        "an endless course": (lambda: lx.course("line", length_m=1e9), "course: length_m: 0"),
        "no look-ahead": (
            lambda: lx.rollout(lx.open_vehicle(vehicle), lx.course("line"), 0.0),
            "call: look_ahead_m: 0, 0.0",
        ),
        "a heading": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, heading_deg=-900.0),
            "call: heading_deg: 0, 360, -900",
        ),
        "no plans": (lambda: lx.record_coverage([], folder, folder / "x.worked.h5"), ": plan: "),
        "a record's name": (lambda: lx.record_coverage(folder, folder, folder / "x.h5"), ": : .worked"),
        "no record": (lambda: lx.open_worked(live), "live.drive.h5: : "),
        "a vehicle's name": (lambda: lx.open_vehicle(vehicle).save(folder / "x.txt"), ": : .vehicle"),
        "no study": (lambda: lx.tune(folder / "none.toml"), "none.toml: file: "),
        "a word for a speed": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, speed_mps="a"),  # type: ignore[arg-type]
            "call: speed_mps: 'a'",
        ),
        "a word for a confidence": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, confidence="x"),  # type: ignore[arg-type]
            "call: confidence: 'x'",
        ),
        "a number of sides": (
            lambda: lx.plan_coverage(_ROOT / "onboard" / "field.geojson", flail, sides=3),  # type: ignore[arg-type]
            "call: sides: ",
        ),
        "no points": (lambda: lx.course(np.zeros((0, 2))), "course: points: 2]"),
        "a huge arc": (lambda: lx.course("arc", radius_m=1e6), "course: radius_m, turn_deg: 100000"),
        "a huge eight": (lambda: lx.course("eight", radius_m=1e5), "course: radius_m: "),
        "far points": (
            lambda: lx.course([[0.0, 0.0], [1e9, 1.0], [0.0, 2.0]]),  # type: ignore[arg-type]
            "course: points: 100000",
        ),
        "an array of hands": (
            lambda: lx.course("arc", hand=np.array(["left", "right"])),  # type: ignore[arg-type]
            "course: hand: ",
        ),
        "uneven look-aheads": (
            lambda: lx.rollout(lx.open_vehicle(vehicle), lx.course("line"), [3.0, [2.0]]),  # type: ignore[arg-type]
            "call: look_ahead_m: 0",
        ),
        "two look-aheads at three speeds": (
            lambda: lx.rollout(
                lx.open_vehicle(vehicle), lx.course("line"), np.array([3.0, 2.0]), speed_mps=np.array([1.0, 2.0, 3.0])
            ),
            "call: look_ahead_m, speed_mps, course: (2,), (3,)",
        ),
        "a word for an effort": (
            lambda: lx.tracking_cost(3.0, lx.open_vehicle(vehicle), lx.course("line"), effort_m2="x"),  # type: ignore[arg-type]
            "call: effort_m2: 0, 'x'",
        ),
        "a time below the map": (lambda: lx.view(site.map, travel_time_ns=500.0), "call: travel_time_ns: 0"),
        "no format": (lambda: lx.check(_ROOT / "README.md"), "README.md: file name: "),
    }


@pytest.mark.parametrize("what", _calls(Path(), Site(Path(), {"live": Path()}, Path())))
def test_wrong_input_is_told_in_one_line(what: str, site: Site, tmp_path: Path) -> None:
    call, told = _calls(tmp_path, site)[what]
    file, place, values = told.split(": ")
    with pytest.raises(InputError) as caught:
        call()
    refusal_in(caught.value).check(place or None, *values.split(", "), file=file or None)
    # No option of the command line.
    assert "--" not in str(caught.value)
    assert not list(tmp_path.iterdir())
