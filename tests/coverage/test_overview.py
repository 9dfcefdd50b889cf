"""A plan as people look at it: the corner that nobody drove to, ways in reverse told apart, for page."""

import json
from pathlib import Path

import numpy as np
import pytest

from lgprjax.coverage import Outline, PatternSettings, Tool, field_of_polygon, ground_of_sides, outline_of
from lgprjax.coverage.pattern import driving_time_s
from lgprjax.coverage.tour import plan_tour
from lgprjax.formats import CoverPlan, read_cover_plan
from lgprjax.frames import LocalFrame
from lgprjax.runtime.coverage.overview import plan_overview, turn_ways
from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan
from refusals import refused

VEHICLE = Path(__file__).resolve().parents[2] / "onboard" / "made_up_flail.vehicle.toml"
FRAME = LocalFrame(48.0, 11.0, 0.0)
DRIVEN_M = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 6.0]])


def driven_plan(folder: Path, corners_m: np.ndarray) -> CoverPlan:
    latitude, longitude, _ = FRAME.to_geodetic(corners_m[:, 0], corners_m[:, 1], np.zeros(len(corners_m)))
    rows = [f"{north:.10f},{east:.10f}" for north, east in zip(latitude, longitude, strict=True)]
    (folder / "c.csv").write_text("\n".join(["latitude_deg,longitude_deg", *rows]) + "\n")
    plan = make_cover_plan(folder / "c.csv", VEHICLE, PlanOptions(order="boustrophedon"))
    assert plan is not None
    save_cover_plan(folder / "c.cover.geojson", plan)
    return plan


@pytest.mark.parametrize("turned", [False, True])
def test_the_corner_that_nobody_drove_to_stays_known(tmp_path: Path, turned: bool) -> None:
    """Also where the corners were driven to clockwise, and the perimeter runs the other way round."""
    plan = driven_plan(tmp_path, DRIVEN_M[::-1] if turned else DRIVEN_M)
    again = read_cover_plan(tmp_path / "c.cover.geojson")
    assert plan.computed_corner is not None
    assert again.computed_corner == plan.computed_corner
    # The plan's frame lies at the first corner.
    expected = np.array([0.0, 6.0]) - DRIVEN_M[2] if turned else np.array([0.0, 6.0])
    np.testing.assert_allclose(plan.pattern.field.perimeter_m[plan.computed_corner], expected, atol=0.01)
    assert plan_overview(again, 0.3)["computed_corner"] == pytest.approx(expected, abs=0.01)
    # A map program shows it.
    collection = json.loads((tmp_path / "c.cover.geojson").read_text())
    (point,) = [each for each in collection["features"] if each["geometry"]["type"] == "Point"]
    assert point["properties"]["kind"] == "computed_corner"
    # It is part of what the digest is over.
    point["properties"]["corner"] = 1
    (tmp_path / "c.cover.geojson").write_text(json.dumps(collection))
    with refused("sha256", file="c.cover.geojson"):
        read_cover_plan(tmp_path / "c.cover.geojson")


def test_where_all_corners_were_given_none_is_computed(tmp_path: Path) -> None:
    plan = driven_plan(tmp_path, np.array([*DRIVEN_M, [0.0, 6.0]]))
    assert plan.computed_corner is None
    assert "computed_corner" not in (tmp_path / "c.cover.geojson").read_text()
    assert plan_overview(plan, 0.3)["computed_corner"] is None


def test_ways_in_reverse_are_told_apart() -> None:
    tool = Tool(1.2, 0.3, 1.2, 0.0)
    outline = outline_of(tool, Outline(1.4, -0.5, 0.65, -0.65), track_m=1.1)
    field = field_of_polygon(np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0]]), name="f")
    ground = ground_of_sides(field.perimeter_m, [0.0, 0.0, 6.0, 6.0], (), 0.25)
    settings = PatternSettings(1.2, 0.2, "free", 1.5, 6.0, 1.2)
    pattern = plan_tour(field, ground, (), settings, tool, outline, name="f").pattern
    signed_m = np.concatenate([turn.pieces[:, 0] for turn in pattern.turns])
    assert (signed_m < 0.0).any()

    def length_m(ways: tuple[np.ndarray, ...]) -> float:
        return float(sum(np.hypot(*np.diff(way, axis=0).T).sum() for way in ways))

    ways = turn_ways(pattern, 0.05)
    assert length_m(ways.reverse_m) == pytest.approx(-signed_m[signed_m < 0.0].sum(), rel=1e-3)
    assert length_m(ways.forward_m) == pytest.approx(signed_m[signed_m > 0.0].sum(), rel=1e-3)
    told = plan_overview(CoverPlan("f", FRAME, pattern, tool, "v", "0" * 64), 0.3)
    assert len(told["swaths"]) == len(pattern.lines)
    assert len(told["reverse"]) == np.count_nonzero(signed_m < 0.0)
    assert told["time_s"] == pytest.approx(driving_time_s(pattern, 0.3), abs=0.5)
