"""A plan made from a plan, whole or for gaps, keeps to the ground that the first one declares safe."""

from pathlib import Path

import pytest
import shapely

from drawn_field import Drive, cover_rows, write_cover_run, write_field
from lgprjax.coverage.ground import breaches
from lgprjax.formats import read_cover_plan, read_vehicle
from lgprjax.recordings.vehicles import outline_of_vehicle
from lgprjax.worked.plans import FieldPlan, PlanOptions, open_cover_plan, plan_field, save_cover_plan
from lgprjax.worked.record import read_cover_run, record_cover
from refusals import refused

_HIGH_M = 850.0
"""Height of the field: lengths of the first plan are counted there."""


def check_within(first: Path, made: FieldPlan, vehicle_file: Path) -> None:
    """Whatever the new plan drives and declares lies within the ground of the first one."""
    outline = outline_of_vehicle(read_vehicle(vehicle_file), vehicle_file)
    ground = read_cover_plan(first).ground
    assert ground is not None
    assert made.plan.ground is not None
    assert breaches(made.plan.pattern, ground, outline) == []
    # Lengths differ by height over the Earth's radius, and no more.
    assert shapely.difference(made.plan.ground.shape, ground.shape.buffer(0.005)).area < 1e-6


def test_a_plan_made_from_a_plan_keeps_to_its_ground(tmp_path: Path) -> None:
    field_file, vehicle_file = write_field(tmp_path, height_m=_HIGH_M)
    made = plan_field(field_file, vehicle_file, PlanOptions(order="free", turning_room_m=2.5))
    assert made is not None
    assert made.plan.rooms_m == ()
    assert made.ground_m < 2.6
    first = tmp_path / "f.cover.geojson"
    save_cover_plan(first, made.plan)
    again = plan_field(first, vehicle_file, PlanOptions(order="free"))
    assert again is not None
    check_within(first, again, vehicle_file)
    assert again.ground_m == pytest.approx(made.ground_m, abs=0.005)
    assert any("f.cover.geojson" in each for each in again.notes)
    # It lasts over more than one file, and another clearance is told.
    second = tmp_path / "g.cover.geojson"
    save_cover_plan(second, again.plan)
    third = plan_field(second, vehicle_file, PlanOptions(order="free", clearance_m=0.2))
    assert third is not None
    assert third.ground_m == pytest.approx(made.ground_m, abs=0.01)
    assert any("0.2 m" in each and "0.25 m" in each for each in third.notes)
    # Turns of an order that needs more room than that are refused, not laid beyond it.
    with refused():
        plan_field(first, vehicle_file, PlanOptions(order="zamboni"))
    # Sides that are told anew, or the room, are others.
    for options in (PlanOptions(order="free", sides=("rest:6",)), PlanOptions(order="free", turning_room_m=6.0)):
        wider = plan_field(first, vehicle_file, options)
        assert wider is not None
        assert not any("f.cover.geojson" in each for each in wider.notes)
        assert wider.ground_m > made.ground_m + 0.5


def test_swaths_beyond_the_border_keep_to_the_ground_of_the_first_plan(tmp_path: Path) -> None:
    field_file, vehicle_file = write_field(tmp_path, height_m=_HIGH_M)
    made = plan_field(field_file, vehicle_file, PlanOptions(order="free", sides=("1:none", "rest:4")))
    assert made is not None
    first = tmp_path / "f.cover.geojson"
    # As a program before version 2.1 wrote it: the ground, without what was said of the sides.
    save_cover_plan(first, made.plan._replace(rooms_m=()))
    again = plan_field(first, vehicle_file, PlanOptions(order="free", confidence=0.95))
    assert again is not None
    check_within(first, again, vehicle_file)


def test_a_plan_for_gaps_keeps_to_the_ground_of_the_first_plan(tmp_path: Path) -> None:
    field_file, vehicle_file = write_field(tmp_path, height_m=_HIGH_M)
    made = plan_field(field_file, vehicle_file, PlanOptions(order="free", turning_room_m=2.5))
    assert made is not None
    first = tmp_path / "f.cover.geojson"
    save_cover_plan(first, made.plan)
    rows, time_s = cover_rows(Drive(((0, 1.0), (1, 3.0))))
    plan = open_cover_plan(first)
    write_cover_run(tmp_path / "run", rows, time_s, plan_sha256=plan.sha256)
    record = record_cover([plan], [read_cover_run(tmp_path / "run")], cell_m=0.1)
    gaps = plan_field(first, vehicle_file, PlanOptions(order="free"), worked=record)
    assert gaps is not None
    check_within(first, gaps, vehicle_file)
