"""The plan of a field: valid GeoJSON, there and back exactly, and refused once it was changed."""

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgprjax.coverage import Field, Pattern, PatternSettings, SafeGround, Tool, plan_pattern
from lgprjax.formats import CoverPlan, check_file, read_cover_plan
from lgprjax.frames import LocalFrame
from lgprjax.worked.plans import save_cover_plan
from refusals import refused

_CHANGED = "sha256"
"""Place of what holds the plan together."""
_TURNED = np.array([[math.cos(0.3), math.sin(0.3)], [-math.sin(0.3), math.cos(0.3)]])


def _plan(lines_m: float = 6.0) -> CoverPlan:
    corners = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, lines_m], [0.0, lines_m]]) @ _TURNED
    settings = PatternSettings(1.0, 0.1, "boustrophedon", 1.2, 12.0, 0.9, heading_rad=None)
    pattern = plan_pattern(Field(corners), settings, name="f")
    frame = LocalFrame(-33.123456789, 151.987654321, 12.5)
    return CoverPlan('the "lower" field, Ä', frame, pattern, Tool(1.0, 0.4, 0.9, 0.0), "flail", "ab" * 32)


def _same(one: Pattern, other: Pattern) -> None:
    np.testing.assert_array_equal(one.field.perimeter_m, other.field.perimeter_m)
    assert one.settings == other.settings
    for name in ("spacing_m", "length_m", "line_length_m", "tightest_radius_m"):
        assert getattr(one, name) == getattr(other, name)
    for name in ("lines", "unreached"):
        for a, b in zip(getattr(one, name), getattr(other, name), strict=True):
            assert a.number == b.number
            np.testing.assert_array_equal(a.start_m, b.start_m)
            np.testing.assert_array_equal(a.end_m, b.end_m)
    for first, second in zip(one.turns, other.turns, strict=True):
        assert first.start == second.start
        np.testing.assert_array_equal(first.pieces, second.pieces)


@pytest.mark.parametrize("across_m", [6.0, 1.0])
def test_what_is_written_is_read_exactly(tmp_path: Path, across_m: float) -> None:
    plan, path = _plan(across_m), tmp_path / "x.cover.geojson"
    save_cover_plan(path, plan)
    read = read_cover_plan(path)
    assert read._replace(pattern=plan.pattern) == plan
    _same(read.pattern, plan.pattern)
    assert len(plan.pattern.turns) == (0 if across_m == 1.0 else len(plan.pattern.lines) - 1)
    assert check_file(path) == []
    with refused("output", "--force"):
        save_cover_plan(path, plan)
    # Other spaces and order are no change.
    table = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps(dict(reversed(table.items())), indent=4))
    _same(read_cover_plan(path).pattern, plan.pattern)


def _area(ring: list[list[float]]) -> float:
    x, y = np.array(ring).T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def test_it_is_geojson_for_any_program(tmp_path: Path) -> None:
    plan, path = _plan(), tmp_path / "x.cover.geojson"
    save_cover_plan(path, plan)
    table = json.loads(path.read_text(encoding="utf-8"), parse_constant=lambda name: pytest.fail(name))
    assert table["type"] == "FeatureCollection"
    first, *others = table["features"]
    (ring,) = first["geometry"]["coordinates"]
    assert first["geometry"]["type"] == "Polygon"
    assert first["properties"]["kind"] == "perimeter"
    assert ring[0] == ring[-1]
    assert _area(ring) > 0.0
    # Lines and turns by turns, each beginning where the vehicle or its tool does.
    assert [each["properties"]["kind"] for each in others] == ["line", "turn"] * len(plan.pattern.turns) + ["line"]
    assert all(each["geometry"]["type"] == "LineString" for each in others)
    for each, line in zip(others[::2], plan.pattern.lines, strict=True):
        places = np.array(each["geometry"]["coordinates"])
        east, north, _ = plan.frame.to_local(places[:, 1], places[:, 0], np.full(2, 12.5))
        np.testing.assert_allclose(np.stack([east, north], axis=1), [line.start_m, line.end_m], atol=1e-4)
        heading = math.degrees(math.atan2(east[1] - east[0], north[1] - north[0])) % 360.0
        assert abs((each["properties"]["heading_deg"] - heading + 180.0) % 360.0 - 180.0) < 0.01


def test_map_programs_open_it(tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio.raw")
    shapely = pytest.importorskip("shapely")
    plan, path = _plan(), tmp_path / "x.cover.geojson"
    save_cover_plan(path, plan)
    told, _, shapes, fields = pyogrio.read(path)
    assert "4326" in told["crs"]
    kinds = dict(zip(told["fields"], fields, strict=True))["kind"]
    geometries = shapely.from_wkb(shapes)
    assert shapely.is_valid(geometries).all()
    assert sum(kinds == "line") == len(plan.pattern.lines)
    assert geometries[0].geom_type == "Polygon"


_CHANGES: list[tuple[Callable[[Any], object], str, tuple[object, ...]]] = [
    (lambda t: t["features"][1]["geometry"]["coordinates"][0].__setitem__(0, 151.9), _CHANGED, ()),
    (lambda t: t["lgprjax"]["settings"].__setitem__("overlap", 0.2), _CHANGED, ()),
    (lambda t: t["lgprjax"]["lines"].pop(), _CHANGED, ()),
    (lambda t: t["features"].pop(), _CHANGED, ()),
    (lambda t: t.pop("lgprjax"), "lgprjax", ("none",)),
    (lambda t: t["lgprjax"].__setitem__("schema", "lgprjax.route"), "@schema", ("lgprjax.cover_plan",)),
    (lambda t: t["lgprjax"].__setitem__("schema_version", "3.0"), "@schema_version", ("3.0",)),
    (lambda t: t["lgprjax"].pop("turns"), "turns", ("none",)),
    (lambda t: t["lgprjax"]["anchor"].pop("height_m"), "anchor.height_m", ("none",)),
    (lambda t: t["lgprjax"]["tool"].__setitem__("width_m", -1.0), "tool.width_m", (-1,)),
    (lambda t: t["lgprjax"]["settings"].__setitem__("order", "spiral"), "settings.order", ("zamboni", "spiral")),
    (lambda t: t["lgprjax"].__setitem__("colour", "red"), "colour", ("data_schema/cover_plan.toml",)),
]


def test_a_changed_plan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.cover.geojson"
    save_cover_plan(path, _plan())
    text = path.read_text(encoding="utf-8")
    for change, place, values in _CHANGES:
        table = json.loads(text)
        change(table)
        path.write_text(json.dumps(table))
        with refused(place, *values, file=path):
            read_cover_plan(path)
        assert place in [finding.place for finding in check_file(path)]


def test_what_is_no_plan_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.cover.geojson"
    for text, place in ((None, "file"), ("", "file"), ("[]", "lgprjax")):
        if text is not None:
            path.write_text(text)
        with refused(place, file=path):
            read_cover_plan(path)


def test_a_plan_with_declared_ground_is_one_that_older_readers_refuse(tmp_path: Path) -> None:
    ring = np.array([[3.0, 2.0], [4.0, 2.0], [4.0, 3.0]])
    outer = np.array([[-5.0, -5.0], [20.0, -5.0], [20.0, 20.0], [-5.0, 20.0]])
    whole = _plan()._replace(ground=SafeGround(((outer, ring),), 0.25), keep_outs_m=(ring,))
    turn = whole.pattern.turns[0]
    backwards = turn._replace(pieces=np.concatenate([turn.pieces, [[-1.5, 0.25], [1.5, 0.25]]]))
    whole = whole._replace(pattern=replace(whole.pattern, turns=(backwards, *whole.pattern.turns[1:])))
    path = tmp_path / "x.cover.geojson"
    save_cover_plan(path, whole)
    assert check_file(path) == []
    read = read_cover_plan(path)
    assert read.ground is not None
    assert read.ground.clearance_m == 0.25
    np.testing.assert_array_equal(read.ground.polygons_m[0][1], ring)
    np.testing.assert_array_equal(read.keep_outs_m[0], ring)
    np.testing.assert_array_equal(read.pattern.turns[0].pieces, backwards.pieces)
    # One that needs nothing of it is what it was.
    save_cover_plan(tmp_path / "y.cover.geojson", _plan())
    versions = [
        json.loads((tmp_path / f"{name}.cover.geojson").read_text())["lgprjax"]["schema_version"] for name in "xy"
    ]
    assert [version.partition(".")[0] for version in versions] == ["2", "1"]
