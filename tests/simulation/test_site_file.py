"""Site files: what a short one becomes, what its words mean, and the one line that each mistake gets."""

from dataclasses import fields
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.scene import NO_FAULTS, WEATHER, SweepPlan
from lgprjax.simulation import Site, plan_site, read_site, site_file
from lgprjax.simulation.site_tables import LIMITS

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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("colour = 3\n" + SHORT, "colour: expected a key among array, day, drive, faults,"),
        ("sede = 3\n" + SHORT, "sede: expected a key, perhaps seed, found an unknown key"),
        (GROUND + "layer_depth_m = []" + LIVE, "ground.layer_depth_m: expected one depth or more, found none"),
        (GROUND + "repeat_m = 1.1\ntrees_per_100m = 6" + LIVE, "ground.trees_per_100m: expected 0, or no such key"),
        (GROUND + "repeat_m = 1.1\nutilities_per_100m = 2" + LIVE, "ground.utilities_per_100m: expected 0, or no such"),
        (
            GROUND + "[radar]\nband_mhz = [100, 102]\nband_edge_mhz = 1" + LIVE,
            "radar.band_mhz: expected a band of 5 MHz",
        ),
        (
            GROUND + "[radar.sweeps]\nfirst_mhz = 1000\nsteps = 50" + LIVE,
            "radar.sweeps: expected frequencies within band_mhz, 100 to 400, found 1000 to 1245",
        ),
        (
            GROUND
            + "[array]\nchannels = 2\n[radar.sweeps]\n[faults.f]\ndead_channels = [0, 1]"
            + LIVE
            + 'faults = "f"',
            "drive[1].faults: expected a live channel, which sweeps are calibrated by, found all channels dead",
        ),
        (SHORT + "lane = 0.3", "drive[2].lane: expected a key, perhaps lane_m, found an unknown key"),
        (SHORT + "lane_m = true", "drive[2].lane_m: expected a number, found True"),
        (SHORT + 'lane_m = "left"', "drive[2].lane_m: expected a number, found 'left'"),
        (SHORT + "lane_m = nan", "drive[2].lane_m: expected -20 to 20, found nan"),
        (SHORT + "lane_m = 1.5", "drive[2].lane_m: expected -1.28 to 1.28, where array and antennas hear ground"),
        (SHORT + "stop_m = 29", "drive[2].stop_m: expected -12 to 27, where road and ground reach"),
        (SHORT + "start_m = 5\nstop_m = 5", "drive[2].stop_m: expected more than start_m, 5, found 5"),
        (SHORT + "stop_m = 0.001", "drive[2].stop_m: expected two scans or more"),
        (SHORT + "direction = 0", "drive[2].direction: expected 1 or -1, found 0"),
        (SHORT + "direction = 2", "drive[2].direction: expected -1 to 1, found 2"),
        (SHORT + "direction = 1.0", "drive[2].direction: expected a whole number, found 1.0"),
        (SHORT + "scan_rate_hz = 9", "drive[2].scan_rate_hz: expected scan_rate_hz in [array], found this key"),
        (SHORT + "wander_wavelength_m = [40, 8]", "drive[2].wander_wavelength_m: expected [from, to] with from before"),
        (SHORT + "wander_wavelength_m = 8", "drive[2].wander_wavelength_m: expected a list of 2, found 8"),
        (SHORT + "roll_sigma_deg = 6", "drive[2].roll_sigma_deg: expected 0 to 5, found 6"),
        (SHORT + "roll_sigma_deg = 1\nroll_sigma_rad = 0.01", "expected roll_sigma_rad or roll_sigma_deg, found both"),
        (SHORT + "day_seed = -1", "drive[2].day_seed: expected a whole number from 0 to 2147483647, found -1"),
        (SHORT + "wander_m = 0.9", "drive[2].wander_m: expected less, so that array and antennas (2.63 m)"),
        (SHORT.replace('"snow"', '"snwo"'), "drive[2].day: expected a day, perhaps snow, found 'snwo'"),
        (SHORT + 'navigation = "rtk"', "drive[2].navigation: expected navigation among standard, survey, found 'rtk'"),
        (SHORT.replace('"live"', '"base"'), "drive[2].name: expected a name that no other drive has, found 'base'"),
        (SHORT.replace('"live"', '"../live"'), "drive[2].name: expected a name of letters"),
        (SHORT.replace('name = "live"', ""), "drive[2].name: expected a name of letters, digits"),
        (SHORT.partition("[[")[0], "drive: expected one [[drive]] or more, found none"),
        ("drive = 3" + SHORT.partition("[[")[0], "drive: expected one [[drive]] or more, found no such list"),
        ("ground = 3", "ground: expected a table, found 3"),
        ("[ground", "file: expected TOML, found"),
        ("[day.snow]" + LAST, "day.snow: expected a name of its own (like = that name)"),
        ('[day.wet]\nlike = "rainy"' + LAST, "day.wet.like: expected a kind of weather, perhaps rain, found 'rainy'"),
        ("[day.wet]\ncover = {index = 1.3}" + LAST, "day.wet.cover.thickness_m: expected a value, found none"),
        ("[day.wet]\ntrenches = [{along_m = [6, 4]}]" + LAST, "day.wet.trenches[1].along_m: expected [from, to]"),
        ("[faults.none]" + LAST, "faults.none: expected a name of its own, found a built-in name"),
        ("[navigation.a]\noutages_s = [[3, 2]]" + LAST, "navigation.a.outages_s[1]: expected [from, to]"),
        ("[ground]\nhalf_width_m = 2.5" + LAST, "ground.half_width_m: expected 2.63 or more, what array and antennas"),
        ("[ground]\nvelocity_m_per_ns = 0.3" + LAST, "ground.velocity_m_per_ns: expected 0.06 to 0.2, found 0.3"),
        (
            "[ground]\nvelocity_m_per_ns = 0.061" + LAST + 'day = "rain"',
            "drive[1].day: expected a velocity in the ground of 0.06 to 0.2 m/ns on that day, found 0.0581 m/ns",
        ),
        ("[road]\nlength_m = 9" + LAST, "road.length_m: expected length_m in [ground], which the road goes by"),
        ("[road]\narcs = [[50, 0.1]]" + LAST, "road.arcs[1]: expected a curvature of -0.01667 to 0.01667 per metre"),
        ("[road]\narcs = [[-1, 0.0]]" + LAST, "road.arcs[1]: expected [length in metres above 0"),
        ('[radar]\nrecording = "both"' + LAST, 'radar.recording: expected "traces" or "sweeps", found \'both\''),
        ('[radar]\nrecording = "traces"\nsweeps = {}' + LAST, 'radar.recording: expected "sweeps", since there is'),
        ("[radar]\nband_mhz = [100, 4000]" + LAST, "radar.band_mhz: expected at most 3125 MHz at this sample_step_ns"),
        ("[radar]\nband_edge_mhz = 200" + LAST, "radar.band_edge_mhz: expected at most half the band, 150, found 200"),
        (
            "[radar.sweeps]\nstep_mhz = 90" + LAST,
            "radar.sweeps.steps: expected at most 3125 MHz at this sample_step_ns",
        ),
        (
            "[radar.sweeps]\nstep_mhz = 50\nsteps = 8" + LAST,
            "radar.sweeps.step_mhz: expected at most 12.9 MHz, unambiguous over the radar's window of 55 ns, found",
        ),
        ("[faults.a]\ndead_channels = [11]" + LAST + 'faults = "a"', "drive[1].faults: expected dead_channels from 0"),
    ],
)
def test_each_mistake_gets_one_line(tmp_path: Path, change: str, message: str) -> None:
    with pytest.raises(InputError) as caught:
        site_of(tmp_path, change)
    line = str(caught.value)
    assert line.startswith(f"{tmp_path / 's.toml'}: ")
    assert message in line
    assert "\n" not in line


def test_a_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="file: expected a readable file, found No such file"):
        read_site(tmp_path / "none.toml")


def test_what_only_planning_finds_names_the_drive(tmp_path: Path) -> None:
    """The wander of this drive goes past three times its rms: found before anything is rendered."""
    site = site_of(tmp_path, SHORT + "lane_m = 0.4\nwander_m = 0.3\nstop_m = 20\nwander_wavelength_m = [2, 3]\n")
    with pytest.raises(InputError, match=r"s.toml: drive\[2\]: expected a drive .*, found the drive hears"):
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
    for given, found in (("town", "no such file"), (tmp_path, "a folder")):
        with pytest.raises(InputError, match=f"site: expected .* among array_sweeps, .*, weather, found {found}"):
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
    with pytest.raises(InputError, match=r"drive\[1\]: .*3 trenches from .* m, more than 2"):
        plan(4, 6, 8)
