"""What a run is loaded from: a route that cannot be driven is kept with its reason, a file of no use refused."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from canon.course import ROOT
from lgprjax.runtime.config import RuntimeConfig, read_config, write_config
from lgprjax.runtime.control.setup import load
from refusals import refused


@pytest.fixture
def folder(course_run: Path, tmp_path: Path) -> Path:
    """A copy of the course's files."""
    for name in ("course.map.h5", "course.route.toml", "course.run.toml"):
        shutil.copy(course_run / name, tmp_path / name)
    text = (tmp_path / "course.route.toml").read_text(encoding="utf-8")
    (tmp_path / "course.route.toml").write_text(text.replace(str(course_run), str(tmp_path)), encoding="utf-8")
    return tmp_path


def with_route(folder: Path, text: str) -> RuntimeConfig:
    """A configuration with a second route."""
    (folder / "other.route.toml").write_text(text, encoding="utf-8")
    config = read_config(folder / "course.run.toml")
    return config.model_copy(update={"routes": ["course.route.toml", "other.route.toml"]})


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda text: text[: len(text) // 2], "other.route.toml"),
        (lambda text: text.replace('map_sha256 = "', 'map_sha256 = "0')[:-1] + "\n", "map_sha256"),
        (lambda text: text.replace("from_m = 0.0", "from_m = 180.0"), "from_m, to_m"),
    ],
)
def test_a_route_that_cannot_be_driven_is_kept_with_its_reason(folder: Path, spoil: object, told: str) -> None:
    good = (folder / "course.route.toml").read_text(encoding="utf-8")
    assert callable(spoil)
    loaded = load(with_route(folder, spoil(good)))
    first, other = loaded.routes
    assert first.path is not None
    assert first.problem == ""
    assert other.path is None
    assert told in other.problem
    assert "\n" not in other.problem


def test_without_any_route_that_can_be_driven_nothing_is_loaded(folder: Path) -> None:
    (folder / "course.route.toml").write_text("", encoding="utf-8")
    with refused("routes"):
        load(read_config(folder / "course.run.toml"))


def test_a_missing_map_and_a_vehicle_without_its_numbers_are_refused(folder: Path) -> None:
    config = read_config(folder / "course.run.toml")
    with refused(file="nowhere.map.h5"):
        load(config.model_copy(update={"map": "nowhere.map.h5"}))
    bare = 'schema = "lgprjax.vehicle"\nschema_version = "1.2"\nname = "x"\nsteering_kind = "counter_steer"\n'
    (folder / "bare.vehicle.toml").write_text(bare, encoding="utf-8")
    with refused(file="bare.vehicle.toml"):
        load(config.model_copy(update={"vehicle": "bare.vehicle.toml"}))


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("name =", "nome =", "nome"),
        ("gnss_delay_s = 0.03", "gnss_delay_s = -1.0", "sensors.gnss_delay_s"),
        ("gnss_delay_s = 0.03", 'gnss_delay_s = "soon"', "sensors.gnss_delay_s"),
        ("[recording]", "[recordings]", "recordings"),
        ("gnss_delay_s = 0.03", "gnss_delay_s = 0.03\nheading_sigma_deg = inf", "sensors.heading_sigma_deg"),
        ("[recording]", "[supervision]\ncontrol_s = 200\n[recording]", "supervision.control_s"),
        ('radar = { url = "socket://127.0.0.1:1" }', "", "map, routes, coverage"),
        ('routes = ["course.route.toml"]', "", "map, routes, coverage"),
        ("[control]", "[control]\ncross_sigmas_m = [0.1, 0.3, 0.2]", "control.cross_sigmas_m"),
        ("[control]", "[control]\ncross_sigmas_m = [0.1, 0.2]", "control.cross_sigmas_m"),
        ("[control]", "[control]\nslow_mps = 0.0", "control.slow_mps"),
        ("[control]", '[registration]\nsearch = "filter"\nwindow_m = 2\n[control]', "registration.window_m"),
        ("[control]", '[registration]\nsearch = "filter"\nfinish = "swarm"\n[control]', "registration.finish"),
    ],
)
def test_a_configuration_that_is_wrong_names_the_place(folder: Path, old: str, new: str, place: str) -> None:
    file = folder / "course.run.toml"
    file.write_text(file.read_text(encoding="utf-8").replace(old, new), encoding="utf-8")
    with refused(place, file=file):
        read_config(file)


def test_without_a_map_the_frame_is_that_of_the_route_and_the_radar_may_stay(folder: Path) -> None:
    text = (folder / "course.run.toml").read_text(encoding="utf-8").replace('map = "course.map.h5"\n', "")
    shutil.copy(ROOT / "onboard" / "front_steer.vehicle.toml", folder / "rtk.vehicle.toml")
    text = re.sub(r'vehicle = ".*"', 'vehicle = "rtk.vehicle.toml"', text, count=1)
    (folder / "rtk.run.toml").write_text(text, encoding="utf-8")
    config = read_config(folder / "rtk.run.toml")
    assert config.ports.radar is not None
    loaded, with_map = load(config), load(read_config(folder / "course.run.toml"))
    assert loaded.frame == with_map.frame
    assert set(loaded.hashes) == {"rtk.vehicle.toml", "course.route.toml"}
    assert np.isinf(float(loaded.setup.navigator.health.silent_s[3]))


def test_a_configuration_written_with_absolute_paths_is_the_same(folder: Path) -> None:
    config = read_config(folder / "course.run.toml")
    registration = config.registration.model_copy(update={"thresholds": "own.thresholds.toml"})
    config = config.model_copy(update={"registration": registration})
    target = folder / "elsewhere" / "written.run.toml"
    target.parent.mkdir()
    write_config(target, config)
    again = read_config(target)
    assert again.registration.thresholds == str(config.path("own.thresholds.toml"))
    assert again.path(again.map).resolve() == config.path(config.map).resolve()
    assert again.simulation == config.simulation
    assert again.control == config.control
    assert again.ports == config.ports
