"""Site files: what a short one becomes, what its words mean, and where each mistake is told."""

from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

from lgprjax.scene import NO_FAULTS, WEATHER, SweepPlan
from lgprjax.simulation import Site, plan_site, read_site, site_file
from lgprjax.simulation.site_tables import LIMITS
from refusals import refused

SITES = Path(__file__).parents[2] / "sites"
SHORT = """
name = "road"
seed = 4
[ground]
length_m = 20
[[drive]]
name = "base"
[[drive]]
name = "live"
day = "snow"
"""


def site_of(folder: Path, text: str) -> Site:
    path = folder / "s.toml"
    path.write_text(text, encoding="utf-8")
    return read_site(path)


def test_ten_lines_are_a_site(tmp_path: Path) -> None:
    site = site_of(tmp_path, SHORT)
    assert (site.header.name, site.sweeps, len(site.array.geometry.y_m)) == ("road", None, 11)
    assert (site.road.length_m, site.road.margin_m) == (20.0, site.ground.margin_m)
    base, live = site.drives
    assert (base.plan.start_m, base.plan.stop_m, base.plan.scan_rate_hz) == (0.0, 20.0, 126.0)
    assert live.day == WEATHER["snow"](live.day.seed)
    assert len({base.seed, live.seed, base.day.seed, live.day.seed}) == 4


def test_seeds_stay_when_a_drive_is_added_or_moved(tmp_path: Path) -> None:
    before = {drive.name: drive for drive in site_of(tmp_path, SHORT).drives}
    head, _, drives = SHORT.partition("[[drive]]")
    added = head + '[[drive]]\nname = "first"\n' + '[[drive]]\nname = "live"\nday = "snow"\n' + "[[drive]]" + drives
    after = {drive.name: drive for drive in site_of(tmp_path, added.rpartition("[[drive]]")[0]).drives}
    assert set(after) == {"first", "live", "base"}
    assert all(after[name] == before[name] for name in before)
    other = {drive.name: drive for drive in site_of(tmp_path, SHORT.replace("seed = 4", "seed = 5")).drives}
    assert all(other[name].seed != before[name].seed for name in before)


def test_words_of_a_file_reach_the_configs(tmp_path: Path) -> None:
    text = """
latitude_deg = 48.1
[ground]
length_m = 30
[road]
arcs = [[10, 0.0], [20, -0.01]]
bank_rms_deg = 1.5
[radar]
recording = "sweeps"
[radar.sweeps]
steps = 31
step_mhz = 10
[array]
channels = 4
scan_rate_hz = 50
[day.wet]
like = "snow"
moisture_rms = 0.01
cover = {thickness_m = 0.05}
trenches = [{along_m = [4, 6]}]
[navigation.bad]
heading_sigma_deg = 2
outages_s = [[1, 2.5]]
odometer_rate_hz = 20
[faults.one]
dead_channels = [3]
[[drive]]
name = "a"
day = "wet"
navigation = "bad"
faults = "one"
lane_m = -0.5
direction = -1
other_ground = 77
seed = 6
[[drive]]
name = "b"
day = "wet"
[[drive]]
name = "c"
day = "wet"
day_seed = 12
faults = "none"
navigation = "survey"
"""
    site = site_of(tmp_path, text)
    a, b, c = site.drives
    assert site.sweeps == SweepPlan(steps=31, step_mhz=10.0)
    assert (site.frame.latitude_deg, site.header.name) == (48.1, "s")
    np.testing.assert_allclose(site.road.bank_rms_rad, np.radians(1.5))
    assert site.road.arcs == ((10.0, 0.0), (20.0, -0.01))
    assert a.day.cover is not None
    snow = WEATHER["snow"](1).cover
    assert snow is not None
    assert (a.day.cover.thickness_m, a.day.cover.relief_m) == (0.05, snow.relief_m)
    assert (a.day.trenches[0].along_m, a.day.trenches[0].depth_m) == ((4.0, 6.0), 1.2)
    assert (a.navigation.outages_s, a.navigation.odometer_rate_hz) == (((1.0, 2.5),), 20.0)
    np.testing.assert_allclose(a.navigation.heading_sigma_rad, np.radians(2.0))
    assert (a.faults.dead_channels, a.seed, a.other_ground, a.plan.direction) == ((3,), 6, 77, -1)
    assert a.day == b.day  # one day, whoever drives
    assert (c.day.seed, c.faults) == (12, NO_FAULTS)
    assert c.navigation.position_sigma_m == 0.01


GROUND = "[ground]\nlength_m = 20\n"
LIVE = '\n[[drive]]\nname = "live"\n'
LAST = '\n[[drive]]\nname = "last"\n'
DEAD = "[array]\nchannels = 2\n[radar.sweeps]\n[faults.f]\ndead_channels = [0, 1]"


@pytest.mark.parametrize(
    ("text", "place", "values"),
    [
        ("sede = 3\n" + SHORT, "sede", ["seed"]),
        (GROUND + "layer_depth_m = []" + LIVE, "ground.layer_depth_m", []),
        (GROUND + "repeat_m = 1.1\ntrees_per_100m = 6" + LIVE, "ground.trees_per_100m", ["0"]),
        (GROUND + "repeat_m = 1.1\nutilities_per_100m = 2" + LIVE, "ground.utilities_per_100m", ["0"]),
        (GROUND + "[radar]\nband_mhz = [100, 102]\nband_edge_mhz = 1" + LIVE, "radar.band_mhz", ["5 MHz"]),
        (GROUND + "[radar.sweeps]\nfirst_mhz = 1000\nsteps = 50" + LIVE, "radar.sweeps", ["400", "1245"]),
        (GROUND + DEAD + LIVE + 'faults = "f"', "drive[1].faults", []),
        (SHORT + 'lane_m = "left"', "drive[2].lane_m", ["left"]),
        (SHORT + "lane_m = nan", "drive[2].lane_m", ["-20", "20", "nan"]),
        (SHORT + "lane_m = 1.5", "drive[2].lane_m", ["-1.28", "1.28"]),
        (SHORT + "stop_m = 29", "drive[2].stop_m", ["-12", "27"]),
        (SHORT + "start_m = 5\nstop_m = 5", "drive[2].stop_m", ["start_m", "5"]),
        (SHORT + "stop_m = 0.001", "drive[2].stop_m", []),
        (SHORT + "direction = 0", "drive[2].direction", ["1", "-1", "0"]),
        (SHORT + "scan_rate_hz = 9", "drive[2].scan_rate_hz", ["[array]"]),
        (SHORT + "wander_wavelength_m = [40, 8]", "drive[2].wander_wavelength_m", []),
        (SHORT + "roll_sigma_deg = 6", "drive[2].roll_sigma_deg", ["0", "5", "6"]),
        (SHORT + "roll_sigma_deg = 1\nroll_sigma_rad = 0.01", "drive[2].roll_sigma_deg", ["roll_sigma_rad"]),
        (SHORT + "day_seed = -1", "drive[2].day_seed", ["0", "2147483647", "-1"]),
        (SHORT + "wander_m = 0.9", "drive[2].wander_m", ["2.63"]),
        (SHORT.replace('"snow"', '"snwo"'), "drive[2].day", ["snow", "snwo"]),
        (SHORT + 'navigation = "rtk"', "drive[2].navigation", ["standard", "survey", "rtk"]),
        (SHORT.replace('"live"', '"base"'), "drive[2].name", ["base"]),
        (SHORT.replace('"live"', '"../live"'), "drive[2].name", ["../live"]),
        (SHORT.replace('name = "live"', ""), "drive[2].name", []),
        (SHORT.partition("[[")[0], "drive", ["[[drive]]"]),
        ("drive = 3" + SHORT.partition("[[")[0], "drive", ["[[drive]]"]),
        ("ground = 3", "ground", ["3"]),
        ("[ground", "file", ["TOML"]),
        ("[day.snow]" + LAST, "day.snow", ["like"]),
        ('[day.wet]\nlike = "rainy"' + LAST, "day.wet.like", ["rain", "rainy"]),
        ("[day.wet]\ncover = {index = 1.3}" + LAST, "day.wet.cover.thickness_m", []),
        ("[day.wet]\ntrenches = [{along_m = [6, 4]}]" + LAST, "day.wet.trenches[1].along_m", []),
        ("[faults.none]" + LAST, "faults.none", []),
        ("[navigation.a]\noutages_s = [[3, 2]]" + LAST, "navigation.a.outages_s[1]", []),
        ("[ground]\nhalf_width_m = 2.5" + LAST, "ground.half_width_m", ["2.63"]),
        ("[ground]\nvelocity_m_per_ns = 0.3" + LAST, "ground.velocity_m_per_ns", ["0.06", "0.2", "0.3"]),
        ("[ground]\nvelocity_m_per_ns = 0.061" + LAST + 'day = "rain"', "drive[1].day", ["0.06", "0.2", "0.0581"]),
        ("[road]\nlength_m = 9" + LAST, "road.length_m", ["[ground]"]),
        ("[road]\narcs = [[50, 0.1]]" + LAST, "road.arcs[1]", ["-0.01667", "0.01667"]),
        ("[road]\narcs = [[-1, 0.0]]" + LAST, "road.arcs[1]", []),
        ('[radar]\nrecording = "both"' + LAST, "radar.recording", ["traces", "sweeps", "both"]),
        ('[radar]\nrecording = "traces"\nsweeps = {}' + LAST, "radar.recording", ["sweeps"]),
        ("[radar]\nband_mhz = [100, 4000]" + LAST, "radar.band_mhz", ["3125"]),
        ("[radar]\nband_edge_mhz = 200" + LAST, "radar.band_edge_mhz", ["150", "200"]),
        ("[radar.sweeps]\nstep_mhz = 90" + LAST, "radar.sweeps.steps", ["3125"]),
        ("[radar.sweeps]\nstep_mhz = 50\nsteps = 8" + LAST, "radar.sweeps.step_mhz", ["12.9", "55"]),
        ("[faults.a]\ndead_channels = [11]" + LAST + 'faults = "a"', "drive[1].faults", ["dead_channels"]),
    ],
)
def test_each_mistake_is_told_by_its_key(tmp_path: Path, text: str, place: str, values: list[str]) -> None:
    with refused(place, *values, file="s.toml"):
        site_of(tmp_path, text)


def test_what_only_planning_finds_names_the_drive(tmp_path: Path) -> None:
    """The wander of this drive goes past three times its rms: found before anything is rendered."""
    with refused("file", file="none.toml"):
        read_site(tmp_path / "none.toml")
    site = site_of(tmp_path, SHORT + "lane_m = 0.4\nwander_m = 0.3\nstop_m = 20\nwander_wavelength_m = [2, 3]\n")
    with refused("drive[2]", file="s.toml"):
        plan_site(site, tmp_path / "s.toml")


@pytest.mark.parametrize("path", sorted(SITES.glob("*.toml")), ids=lambda path: path.stem)
def test_example_sites_can_be_driven(path: Path) -> None:
    site = read_site(path)
    assert site.header.name == path.stem
    planned = plan_site(site, path, [site.drives[-1].name])
    assert [entry.drive.name for entry in planned.drives] == [site.drives[-1].name]
    assert planned.drives[0].scans > 500


def test_an_example_is_found_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "village").mkdir()  # as a run left it that wrote its drives there
    assert site_file("village").read_bytes() == (SITES / "village.toml").read_bytes()
    for given in ("town", tmp_path):
        with refused("site", "array_sweeps", "weather"):
            site_file(given)


def test_every_number_has_a_range() -> None:
    """A field that is added to a config must be given its range."""
    for kind, limits in LIMITS.items():
        hints = get_type_hints(kind)
        numbers = {f.name for f in fields(kind) if _holds_number(hints[f.name])}
        left_out = {
            "RoadConfig": {"length_m", "margin_m"},
            "RadarConfig": {"height_m"},
            "DrivePlan": {"scan_rate_hz"},
        }.get(kind.__name__, set())
        assert numbers - left_out == set(limits), kind.__name__


def _holds_number(hint: object) -> bool:
    return hint in (int, float) or any(_holds_number(inner) for inner in get_args(hint))


def test_more_trenches_than_a_block_of_scans_hears_are_refused_before_anything_is_rendered(tmp_path: Path) -> None:
    def plan(*starts_m: int) -> None:
        trenches = "".join(f"[[day.dug.trenches]]\nalong_m = [{at}, {at + 1}]\n" for at in starts_m)
        plan_site(site_of(tmp_path, GROUND + trenches + LIVE + 'day = "dug"'), tmp_path / "s.toml")

    plan(2, 4, 18)
    with refused("drive[1]", "3", "2"):
        plan(4, 6, 8)
