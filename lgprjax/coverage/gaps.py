"""Lines over what was left out: a plan from the recorded map of the same field.

Cells left out are taken together in tool-wide strips of the lines' direction, each laid in the middle of what it is to
work. The vehicle enters and leaves a strip at the perimeter and crosses it straight, with the tool off on ground worked
before: no turn inside the field, and a straight way on to the next gap of a strip is shorter than any turn. Strips
follow each other by the nearest that a turn leads to.
"""

import math

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage.cells import CellGrid, cell_centres, inside_cells
from lgprjax.coverage.end_arcs import Pieces
from lgprjax.coverage.field import Field
from lgprjax.coverage.lines import MOST_LINES, join_spans, lines_heading_rad, strip_pieces, to_lines
from lgprjax.coverage.passes import Pass, lines_of_pass, reference_pose, string_passes
from lgprjax.coverage.pattern import Pattern, check_ends, pattern_of
from lgprjax.coverage.pattern_settings import PatternSettings
from lgprjax.coverage.turn_search import find_turn
from lgprjax.errors import InputError


def plan_gaps(
    field: Field,
    worked: Bool[np.ndarray, "north east"],
    grid: CellGrid,
    settings: PatternSettings,
    *,
    name: str,
) -> Pattern | None:
    """Lines over the cells of a field that were not worked; ``None`` where none was left out.

    Gaps of one strip nearer to each other than the tool is wide are one line, and a line goes on by half that width
    beyond its cells, within the field.

    Args:
        field: of the first plan.
        worked: cells that count as worked.
        grid: of the cells.
        settings: of the pattern; its order is not used.
        name: of the record, or its file, for errors.

    Returns:
        A pattern whose ``unreached`` holds the lines that no turn within the room leads to.

    Raises:
        InputError: a map that is not of the grid's size, too many strips or too long a way, or too little room to
            begin.
    """
    if worked.shape != grid.shape:
        raise InputError(name, "map", f"{grid.shape} cells", f"{worked.shape}")
    heading_rad = lines_heading_rad(field, settings.heading_rad)
    corners_m = to_lines(field.perimeter_m, heading_rad)
    rows, columns = np.nonzero(inside_cells(field, grid) & ~worked)
    if len(rows) == 0:
        return None
    east_m, north_m = cell_centres(grid)
    places_m = to_lines(np.stack([east_m[columns], north_m[rows]], axis=1), heading_rad)
    half_m = 0.5 * grid.cell_m * (abs(math.cos(heading_rad)) + abs(math.sin(heading_rad)))
    spacing_m = (1.0 - settings.overlap) * settings.tool_width_m
    strips = _strips(places_m, half_m, spacing_m, name)
    drives = [
        each
        for number, (across_m, along_m) in enumerate(strips)
        for each in _drives(corners_m, number + 1, across_m, along_m, half_m, settings.tool_width_m)
    ]
    reached, joints, unreached = _string(corners_m, drives, settings)
    check_ends(corners_m, reached, settings, name)
    lines, turns = string_passes(reached, joints, settings, heading_rad)
    missed = tuple(line for drive in unreached for line in lines_of_pass(drive, heading_rad))
    return pattern_of(field, settings, lines, turns, spacing_m, unreached=missed, name=name)


def _strips(
    places_m: Float[np.ndarray, "cell 2"], half_m: float, width_m: float, name: str
) -> list[tuple[float, Float[np.ndarray, " part"]]]:
    """Fewest strips of a width over cells: the middle of each, and where along it its cells are."""
    ordered = places_m[np.argsort(places_m[:, 1])]
    across = ordered[:, 1]
    strips = []
    begin = 0
    while begin < len(across):
        # A strip narrower than a cell still takes the cells of one row.
        end = int(np.searchsorted(across, max(across[begin] + width_m - 2.0 * half_m, across[begin]), side="right"))
        strips.append((0.5 * float(across[begin] + across[end - 1]), ordered[begin:end, 0]))
        begin = end
    if len(strips) > MOST_LINES:
        raise InputError(name, "gaps", f"at most {MOST_LINES} strips", f"{len(strips)}")
    return strips


def _drives(
    corners_m: Float[np.ndarray, "corner 2"],
    number: int,
    across_m: float,
    along_m: Float[np.ndarray, " part"],
    half_m: float,
    tool_width_m: float,
) -> list[Pass]:
    """Drives along one strip, one for each piece of the field that has gaps in it."""
    drives = []
    spans = strip_pieces(corners_m, across_m, tool_width_m)
    piece = np.clip(np.searchsorted([low for low, _ in spans], along_m, side="right") - 1, 0, len(spans) - 1)
    for place, (low_m, high_m) in enumerate(spans):
        cells = np.unique(along_m[piece == place])
        if len(cells) == 0:
            continue
        gaps = join_spans([(float(each) - half_m, float(each) + half_m) for each in cells], tool_width_m)
        longer = [(max(low - 0.5 * tool_width_m, low_m), min(high + 0.5 * tool_width_m, high_m)) for low, high in gaps]
        drives.append(Pass(number, across_m, (low_m, high_m), True, join_spans(longer, 0.0)))
    return drives


def _string(
    corners_m: Float[np.ndarray, "corner 2"], drives: list[Pass], settings: PatternSettings
) -> tuple[list[Pass], list[Pieces], list[Pass]]:
    """Drives in driving order, what joins them, and those that nothing joins to the rest."""
    reached, joints, remaining = [drives[0]], [], drives[1:]
    while remaining:
        entries = [drive._replace(forward=forward) for drive in remaining for forward in (True, False)]
        entries.sort(key=lambda entry: _estimate_m(reached[-1], entry, settings))
        for entry in entries:
            found = find_turn(corners_m, reached[-1], entry, reached, drives, settings, one_handed=False)
            if found.pieces is not None:
                break
        else:
            break
        reached.append(entry)
        joints.append(found.pieces)
        remaining = [drive for drive in remaining if drive != entry._replace(forward=True)]
    return reached, joints, remaining


def _estimate_m(before: Pass, after: Pass, settings: PatternSettings) -> float:
    """About how long a turn is, for the order in which turns are tried: lines nearer than the circle cost a bulb."""
    start = reference_pose(before, before.end_m, settings)
    end = reference_pose(after, after.start_m, settings)
    apart_m = abs(end.y_m - start.y_m)
    return math.hypot(end.x_m - start.x_m, apart_m) + 2.0 * max(2.0 * settings.smallest_radius_m - apart_m, 0.0)
