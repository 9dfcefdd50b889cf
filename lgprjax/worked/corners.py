"""Corners of a field from its file, in metres of a plan: corrections to them, and the one that is computed."""

import math
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.coverage import Field, field_of_corners, field_of_polygon
from lgprjax.coverage.field import SQUARED_M, Corners, signed_area_m2
from lgprjax.coverage.ground import buffered
from lgprjax.errors import InputError
from lgprjax.formats.field_files import FieldPlaces, KeepOut
from lgprjax.formats.worked import WorkedRecord
from lgprjax.frames import LocalFrame

_TOLD_M = 0.02
# Largest difference between the perimeters of a record and of a plan for its gaps.
_SAME_FIELD_M = 0.05


def field_of_places(places: FieldPlaces, frame: LocalFrame, name: str) -> tuple[Field, list[str], int | None]:
    """Field from the corners of its file, notes on changes to them, and index of the corner that was not driven to.

    Args:
        places: corners and keep-outs of the field's file.
        frame: local frame of the plan.
        name: name of the file, for messages.

    Raises:
        InputError: the corners form no field.
    """
    corners = _local(places, frame)
    notes = list(places.notes)
    if not places.driven:
        field = field_of_polygon(corners, name=name)
        dropped = len(corners) - len(field.perimeter_m)
        if dropped:
            notes.append(f"{dropped} corners left out: same position as the corner before")
        return field, notes, None
    field = field_of_corners(corners, name=name)
    for number, corner in enumerate(corners):
        moved_m = float(np.hypot(*(field.perimeter_m - corner).T).min())
        if moved_m > _TOLD_M:
            notes.append(f"corner {number + 1} moved by {moved_m:.2f} m to make a rectangle")
    far = [np.hypot(*(corners - each).T).min() > 2.0 * SQUARED_M for each in field.perimeter_m]
    computed = far.index(True) if any(far) else 3
    fourth = field.perimeter_m[computed]
    latitude, longitude, _ = frame.to_geodetic(fourth[:1], fourth[1:], np.zeros(1))
    notes.append(f"the fourth corner is computed: {latitude[0]:.8f}, {longitude[0]:.8f}; visit it before you drive")
    return field, notes, computed


def _local(places: FieldPlaces | KeepOut, frame: LocalFrame) -> Corners:
    return east_north(np.stack([places.latitude_deg, places.longitude_deg, places.height_m], axis=1), frame)


def east_north(ring: Float[np.ndarray, "corner 3"], frame: LocalFrame) -> Corners:
    """East and north of corners given by latitude, longitude and height, m."""
    east, north, _ = frame.to_local(*ring.T)
    return np.stack([east, north], axis=1)


def keep_out_of(ring: KeepOut, frame: LocalFrame, buffer_m: float) -> Corners:
    """A keep-out widened by its own buffer, or by ``buffer_m`` if its file states none."""
    return buffered(_local(ring, frame), buffer_m if ring.buffer_m is None else ring.buffer_m)


def counter_clockwise(places: FieldPlaces) -> bool:
    """Whether the corners run counter-clockwise in their file."""
    return signed_area_m2(np.stack([places.longitude_deg, places.latitude_deg], axis=1)) > 0.0


def check_same_field(field: Field, worked: WorkedRecord, field_file: str | Path) -> None:
    """Refuse a record of another field.

    Raises:
        InputError: the record's perimeter differs from the field's.
    """
    here, there = field.perimeter_m, worked.perimeter_m
    apart_m = math.inf
    if here.shape == there.shape:
        turned = [np.roll(there, shift, axis=0) for shift in range(len(there))]
        apart_m = min(float(np.hypot(*(here - each).T).max()) for each in turned)
    if apart_m > _SAME_FIELD_M:
        found = (
            "a different number of corners" if math.isinf(apart_m) else f"corners up to {apart_m:.2f} m from its own"
        )
        raise InputError(field_file, "perimeter", f"the field of the record, {worked.name}", found)
