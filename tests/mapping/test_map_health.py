"""A map's faults are found where they were put, and a sound map is called good."""

from pathlib import Path

import numpy as np
import pytest

from canon.map import of_many_grounds
from canon.site import Site
from lgprjax.formats import MAP_PRECISIONS, MapFile, MapWriter, import_lines
from lgprjax.mapping import MapHealth, build_map, verify_map
from lgprjax.mapping.matching import TileMask, ground_at
from lgprjax.subsurface import StationBlock

HOLE_M = (9.0, 12.0)  # of the route
ALIKE_M = (22.0, 31.0)
SHIFT_M = 0.1
PERIOD_M = 1.2


def verified(path: Path) -> MapHealth:
    with MapFile.open(path) as source:
        return verify_map(source)


def damage(source: Path, target: Path) -> Path:
    """A hole in both baselines, the second 0.1 m to the north, and ground that repeats itself."""
    with MapFile.open(source) as held, MapWriter.create(target, precision=MAP_PRECISIONS["full"]) as writer:
        every = np.arange(len(held.places))
        places, stations = held.places.read(every), held.read_stations(every)
        pose, drive, profile = places.pose.copy(), places.drive, stations.profile.copy()
        start_m = pose[drive == 0, 0].min()
        step_m = float(np.median(np.diff(pose[drive == 0, 0])))
        period = round(PERIOD_M / step_m)
        for number in (0, 1):
            mine = np.flatnonzero(drive == number)
            alike = mine[(pose[mine, 0] - start_m >= ALIKE_M[0]) & (pose[mine, 0] - start_m <= ALIKE_M[1])]
            profile[alike] = profile[alike[np.arange(len(alike)) % period]]
        pose[drive == 1, 1] += SHIFT_M
        along = pose[:, 0] - start_m
        for number in (0, 1):
            kept = (drive == number) & ((along < HOLE_M[0]) | (along > HOLE_M[1]))
            block = StationBlock(
                profile[kept],
                stations.valid[kept],
                pose[kept],
                places.ground_up_m[kept],
                stations.antenna_m[kept],
                step_m * every[kept],
            )
            writer.append(block, number)
        writer.finish(held.description, held.tile_frame, held.height_reference_m, held.provenance)
    return target


@pytest.fixture(scope="module")
def sound(site: Site) -> MapHealth:
    return verified(site.map)


@pytest.fixture(scope="module")
def damaged(site: Site, tmp_path_factory: pytest.TempPathFactory) -> MapHealth:
    return verified(damage(site.map, tmp_path_factory.mktemp("damaged") / "damaged.map.h5"))


def test_a_sound_map_is_called_good(sound: MapHealth) -> None:
    assert {f.kind: f.verdict for f in sound.findings} == dict.fromkeys(
        ("coverage", "holes", "weak", "ambiguous", "offset", "disagreement", "channels"), "good"
    )
    assert sound.verdict == "good"
    assert sound.length_m == pytest.approx(35.0, abs=1.0)
    assert np.all(sound.places["passes"] == 2)


def test_a_hole_is_found_where_it_was_cut(damaged: MapHealth, site: Site) -> None:
    finding = damaged.finding("holes")
    assert finding.verdict == "bad"
    (hole,) = finding.where
    assert hole.start_m == pytest.approx(HOLE_M[0], abs=1.0)
    assert hole.stop_m == pytest.approx(HOLE_M[1], abs=1.0)
    assert hole.worst == 0.0
    # Its ends are places on the globe.
    with MapFile.open(site.map) as source:
        east, north, _ = source.description.frame.to_local(*(np.array([v]) for v in (*hole.start, 0.0)))
        first = source.pose[0]
    # Ends are the middles of the first and last place, half a metre inside the interval.
    assert float(east[0]) - first[0] == pytest.approx(hole.start_m + 0.5, abs=0.2)
    assert abs(float(north[0])) < 0.5
    # As plain numbers and names.
    plain = damaged.as_json()
    findings = plain["findings"]
    assert isinstance(findings, list)
    (row,) = (row for row in findings if row["kind"] == "holes")
    assert (row["verdict"], plain["verdict"]) == ("bad", "bad")
    assert row["where"][0]["start_m"] == pytest.approx(hole.start_m, abs=0.01)


def test_a_shifted_baseline_is_measured(damaged: MapHealth) -> None:
    """The second baseline was moved to the left: the others' ground puts it to the right, and the first to the left."""
    table = damaged.agreement
    clear = table[(table["code"] == "ok") & ~table["route_m"].between(ALIKE_M[0] - 2.0, ALIKE_M[1] + 2.0)]
    for baseline, expected in ((0, SHIFT_M), (1, -SHIFT_M)):
        mine = clear[clear["baseline"] == baseline]
        assert len(mine) >= 15
        assert float(mine["cross_m"].median()) == pytest.approx(expected, abs=0.02)
        assert abs(float(mine["along_m"].median())) < 0.025
    finding = damaged.finding("offset")
    assert finding.verdict != "good"
    assert finding.value == pytest.approx(SHIFT_M, abs=0.02)


def test_ground_that_resembles_itself_is_ambiguous_there_and_nowhere_else(damaged: MapHealth) -> None:
    finding = damaged.finding("ambiguous")
    assert finding.verdict != "good"
    flagged = np.zeros(len(damaged.places), bool)
    for interval in finding.where:
        flagged |= damaged.places["route_m"].between(interval.start_m, interval.stop_m).to_numpy()
    at = damaged.places["route_m"].to_numpy()
    # A rival stands a period away: within one of the rim, one of the two neighbours is other ground.
    inside = (at > ALIKE_M[0] + 0.5) & (at < ALIKE_M[1] - 0.5)
    assert flagged[inside].mean() > 0.8
    assert not flagged[(at < ALIKE_M[0] - 0.5) | (at > ALIKE_M[1] + 0.5)].any()


def test_width_and_overlap_of_a_strip_by_hand() -> None:
    """Ground 1 m wide under a place 0.2 m left of its right edge, and an array of five channels at 0.2 m."""
    cross = np.arange(41) * 0.1 - 2.0
    valid = np.tile((cross >= -0.21) & (cross <= 0.81), (30, 1))
    mask = TileMask(valid, np.array([-1.5, -2.0]), np.array([0.1, 0.1]))
    width, overlap = ground_at(mask, np.zeros(3), 5, 0.2)
    assert width == pytest.approx(1.0, abs=0.11)
    # Channels at -0.4, -0.2, 0, 0.2, 0.4: the rightmost is off, that at the rim by rounding on or off.
    assert overlap in (0.6, 0.8)
    assert ground_at(mask, np.array([0.0, -1.0, 0.0]), 5, 0.2) == (0.0, 0.0)
    # Turned across the strip the array lies along it: all channels are on.
    assert ground_at(mask, np.array([0.0, 0.3, np.pi / 2]), 5, 0.2)[1] == 1.0


@pytest.mark.real
def test_the_line_that_differs_is_named(real_data: Path, tmp_path: Path) -> None:
    """Of 25 parallel lines the last was recorded with opposite polarity, starting elsewhere."""
    lines = [real_data / "gpr_o_parallel_lines" / f"XLINE{number:02d}.DT1" for number in range(16, 25)]
    import_lines(lines, line_spacing_m=0.2, output=tmp_path / "lines.drive.h5")
    build_map([tmp_path / "lines.drive.h5"], tmp_path / "lines.map.h5", measure=of_many_grounds)
    health = verified(tmp_path / "lines.map.h5")
    finding = health.finding("channels")
    assert finding.verdict == "bad"
    assert [interval.channel for interval in finding.where] == [8]
    assert health.finding("holes").verdict == "good"
