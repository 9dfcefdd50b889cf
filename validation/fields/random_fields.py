"""Fields drawn at random: 3 to 200 corners, concave, with keep-outs and sides without room; and what can be reached.

The bound on what can be reached is a raster of its own in plain NumPy and SciPy: every heading of a ladder, the
vehicle's rectangle eroded out of the ground, the tool's rectangle dilated back. It knows nothing of swaths or of ways.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy import fft, ndimage, signal, sparse

from lgprjax.coverage import (
    Field,
    Outline,
    PatternSettings,
    SafeGround,
    Tool,
    field_of_polygon,
    ground_of_sides,
    outline_of,
)
from lgprjax.coverage.ground import buffered

CELL_M = 0.1
HEADINGS = 32


class DrawnField(NamedTuple):
    """A field, what may be driven on, and the vehicle.

    Attributes:
        field, keep_outs_m, rooms_m, ground: as drawn.
        settings, tool, outline: of the vehicle.
    """

    field: Field
    keep_outs_m: tuple[Float[np.ndarray, "_ 2"], ...]
    rooms_m: list[float]
    ground: SafeGround
    settings: PatternSettings
    tool: Tool
    outline: Outline


def draw_field(seed: int) -> DrawnField:
    """A field of 60 to 1500 m2 with at least one side that has room to come in from."""
    rng = np.random.default_rng(seed)
    tool = Tool(float(rng.uniform(0.8, 2.0)), 0.3, float(rng.uniform(0.6, 1.6)), 0.0)
    half_m = 0.5 * tool.width_m + float(rng.uniform(0.0, 0.1))
    body = Outline(tool.ahead_m + 0.2, -float(rng.uniform(0.3, 0.9)), half_m, -half_m)
    radius_m = float(rng.uniform(1.0, 2.5))
    corners = _corners(rng)
    field = field_of_polygon(corners, name=f"seed {seed}")
    count = len(field.perimeter_m)
    deep_m = tool.ahead_m + 3.5 * radius_m + body.front_m
    share = rng.choice([0.0, 0.3, 0.6])
    rooms = [0.0 if rng.random() < share else float(rng.uniform(0.7, 1.2)) * deep_m for _ in range(count)]
    if count > 8:
        # Sides of many corners have or lack room by stretches, as hedges and roads do.
        blocks = np.repeat(rng.random(4) < share, math.ceil(count / 4))[:count]
        rooms = [0.0 if shut else deep_m for shut in blocks]
    sides = np.hypot(*(np.roll(field.perimeter_m, -1, axis=0) - field.perimeter_m).T)
    if not any(rooms):
        rooms = [deep_m if count > 8 and side > 0.0 else 0.0 for side in sides]
        rooms[int(np.argmax(sides))] = deep_m
    keep_outs = tuple(_keep_outs(rng, field, int(rng.integers(0, 6))))
    ground = ground_of_sides(field.perimeter_m, rooms, keep_outs, 0.25)
    settings = PatternSettings(tool.width_m, 0.2, "free", radius_m, deep_m, tool.ahead_m)
    return DrawnField(
        field, keep_outs, rooms, ground, settings, tool, outline_of(tool, body, track_m=0.9 * tool.width_m)
    )


def _corners(rng: np.random.Generator) -> Float[np.ndarray, "corner 2"]:
    """Rectangles with notches, stars, and smooth outlines of many corners."""
    kind = rng.integers(4)
    size_m = float(rng.uniform(10.0, 32.0))
    if kind == 0:
        count = int(rng.integers(3, 9))
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        while np.max(np.diff(np.append(angle, angle[0] + 2.0 * np.pi))) > 0.9 * np.pi:
            angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        radius = size_m * rng.uniform(0.55, 1.0, count)
    elif kind == 1:
        count = int(rng.integers(5, 13))
        angle = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2.0 * np.pi / count
        radius = size_m * rng.uniform(0.35, 1.0, count)
    elif kind == 2:
        count = int(rng.integers(30, 201))
        angle = np.arange(count) * 2.0 * np.pi / count
        waves = np.zeros(count)
        for order in range(2, 6):
            waves += rng.uniform(0.0, 0.25) / order * np.cos(order * angle + rng.uniform(0.0, 6.3))
        radius = 0.7 * size_m * (1.0 + waves)
    else:
        return _notched(rng, size_m)
    corners = np.stack([np.cos(angle) * radius, np.sin(angle) * radius * rng.uniform(0.5, 1.0)], axis=1)
    shape = shapely.Polygon(corners)
    return corners if shape.is_valid and shape.area > 60.0 else _notched(rng, size_m)


def _notched(rng: np.random.Generator, size_m: float) -> Float[np.ndarray, "corner 2"]:
    """A rectangle with one to three rectangles cut out of its border: L, T and U shapes."""
    wide, high = size_m, size_m * rng.uniform(0.5, 1.2)
    shape = shapely.box(0.0, 0.0, wide, high)
    for _ in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(0.0, wide), rng.choice([0.0, high])
        cut = shapely.box(x, y - 0.5 * high * rng.uniform(0.3, 1.0), x + rng.uniform(0.15, 0.4) * wide, y + 0.5 * high)
        rest = shapely.difference(shape, cut)
        if rest.geom_type == "Polygon" and rest.area > 60.0 and len(rest.interiors) == 0:
            shape = rest
    turned = rng.uniform(0.0, np.pi)
    cos, sin = math.cos(turned), math.sin(turned)
    turned_corners: Float[np.ndarray, "_ 2"] = np.asarray(shape.exterior.coords)[:-1] @ np.array(
        [[cos, sin], [-sin, cos]]
    )
    return turned_corners


def _keep_outs(rng: np.random.Generator, field: Field, count: int) -> list[Float[np.ndarray, "corner 2"]]:
    low, high = field.perimeter_m.min(axis=0), field.perimeter_m.max(axis=0)
    rings = []
    for _ in range(count):
        corners = int(rng.integers(3, 9))
        angle = np.arange(corners) * 2.0 * np.pi / corners
        ring = rng.uniform(low, high) + rng.uniform(0.2, 2.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        rings.append(buffered(ring, float(rng.uniform(0.0, 1.0))))
    return rings


def reachable(drawn: DrawnField) -> tuple[Bool[np.ndarray, "row column"], Bool[np.ndarray, "row column"], float]:
    """Cells of the field, those that the tool can be over with the vehicle within the ground, and a cell's area.

    A place counts if some heading of the ladder lets the vehicle stand there and it can be driven to from outside the
    field: places of one heading join straight on, those of neighbouring headings where both fit.
    """
    shape = drawn.ground.kept
    low, high = np.split(np.array(shapely.total_bounds(shape)), 2)
    low = low - 3.0
    columns, rows = (int(each) for each in np.ceil((high + 3.0 - low) / CELL_M))
    x, y = np.meshgrid(low[0] + CELL_M * (np.arange(columns) + 0.5), low[1] + CELL_M * (np.arange(rows) + 0.5))
    shapely.prepare(shape)
    free = shapely.contains_xy(shape, x, y)
    field = shapely.Polygon(drawn.field.perimeter_m)
    inside = shapely.contains_xy(field, x, y)
    target = inside.copy()
    for ring in drawn.keep_outs_m:
        target &= ~shapely.contains_xy(shapely.Polygon(ring), x, y)
    # What lies partly beyond a cell's centre counts as free: the bound is generous by less than a cell.
    stands = np.stack([_erode(free, drawn.outline, heading) for heading in _headings()])
    joined = np.concatenate([stands, stands[:1]])
    labels, _ = ndimage.label(joined, structure=np.ones((3, 3, 3)))
    outside = labels[:, ~inside]
    count = int(labels.max()) + 1
    parent = np.arange(count)
    # The first heading is the last one again.
    for one, other in zip(labels[0][stands[0]], labels[-1][stands[0]], strict=True):
        a, b = int(parent[one]), int(parent[other])
        if a != b:
            parent[parent == b] = a
    entered = np.isin(parent, np.unique(parent[np.unique(outside[outside > 0])]))
    entered[0] = False
    reached = np.zeros_like(target)
    for number, heading in enumerate(_headings()):
        reached |= _dilate(entered[labels[number]], drawn.tool, heading)
    return target, target & reached, CELL_M**2


def _headings() -> Float[np.ndarray, " heading"]:
    return np.arange(HEADINGS) * 2.0 * np.pi / HEADINGS


def _kernel(front: float, rear: float, left: float, right: float, heading: float) -> Float[np.ndarray, "row column"]:
    """Cells of a rectangle about the origin, mirrored for use in a convolution."""
    reach = math.ceil(max(math.hypot(a, b) for a in (front, rear) for b in (left, right)) / CELL_M) + 1
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1] * CELL_M
    ahead, aside = (
        column * math.cos(heading) + row * math.sin(heading),
        row * math.cos(heading) - column * math.sin(heading),
    )
    return np.asarray((ahead <= front) & (ahead >= rear) & (aside <= left) & (aside >= right), np.float32)


def _erode(free: Bool[np.ndarray, "row column"], outline: Outline, heading: float) -> Bool[np.ndarray, "row column"]:
    kernel = _kernel(*outline, heading)
    shut = signal.fftconvolve((~free).astype(np.float32), kernel[::-1, ::-1], mode="same")
    return np.asarray(shut < 0.5)


def _dilate(stands: Bool[np.ndarray, "row column"], tool: Tool, heading: float) -> Bool[np.ndarray, "row column"]:
    half = 0.5 * tool.width_m
    kernel = _kernel(tool.ahead_m + 0.5 * tool.length_m, tool.ahead_m - 0.5 * tool.length_m, half, -half, heading)
    return np.asarray(signal.fftconvolve(stands.astype(np.float32), kernel, mode="same") > 0.5)


def worked_share(drawn: DrawnField, lines: list[Float[np.ndarray, "2 2"]]) -> tuple[float, float]:
    """Share of what can be reached that lines work, and reachable area, m2: from the lines' rectangles alone."""
    target, reached, cell_m2 = reachable(drawn)
    del target
    shape = drawn.ground.kept
    low = np.array(shapely.total_bounds(shape))[:2] - 3.0
    rows, columns = np.nonzero(reached)
    places = np.stack([low[0] + CELL_M * (columns + 0.5), low[1] + CELL_M * (rows + 0.5)], axis=1)
    done = _worked(places, drawn.tool, lines)
    return float(np.mean(done)) if len(done) else 1.0, float(np.count_nonzero(reached)) * cell_m2


def _worked(
    places: Float[np.ndarray, "cell 2"], tool: Tool, lines: Sequence[Float[np.ndarray, "2 2"]]
) -> Bool[np.ndarray, " cell"]:
    """Which places the tool's rectangle passes on lines of its centre."""
    done = np.zeros(len(places), bool)
    for start, end in lines:
        length = float(np.hypot(*(end - start)))
        along = (end - start) / max(length, 1e-9)
        away = places - start
        ahead, aside = away @ along, away @ np.array([-along[1], along[0]])
        half = 0.5 * tool.length_m
        done |= (ahead >= -half) & (ahead <= length + half) & (np.abs(aside) <= 0.5 * tool.width_m)
    return done


# A bound by how the vehicle moves: finer, of every heading of a ladder and of every long side of the ground.

FINE_M = 0.05
LEAST_SWATH_M = 0.3
_LONG_SIDE_M = 1.0
_MOST_SIDES = 12
_COMPONENTS = 3


class Bound(NamedTuple):
    """What can be worked at most, on a raster.

    Attributes:
        cell_m: side of its cells.
        low_m: east and north of the raster's first corner.
        target, reached: cells to be worked, and of them those that can be.
    """

    cell_m: float
    low_m: Float[np.ndarray, "2"]
    target: Bool[np.ndarray, "row column"]
    reached: Bool[np.ndarray, "row column"]

    @property
    def reached_m2(self) -> float:
        return float(np.count_nonzero(self.reached)) * self.cell_m**2

    def share(self, drawn: DrawnField, lines: Sequence[Float[np.ndarray, "2 2"]]) -> float:
        """Of what can be worked, what lines do."""
        places = self.places()
        return float(np.mean(_worked(places, drawn.tool, lines))) if len(places) else 1.0

    def places(self) -> Float[np.ndarray, "cell 2"]:
        """East and north of what can be worked."""
        rows, columns = np.nonzero(self.reached)
        return np.asarray(self.low_m + self.cell_m * (np.stack([columns, rows], axis=1) + 0.5))


def bound_by_motion(drawn: DrawnField, cell_m: float = FINE_M) -> Bound:
    """Cells that the tool can be over on a straight way forwards of ``LEAST_SWATH_M`` that the vehicle can get to.

    Poses of one heading are joined wherever they touch, so that sliding sideways costs nothing. From one heading to the
    next leads an arc of the smallest radius alone, forwards or in reverse: a vehicle that has no room for it cannot
    turn. The ladder has ``HEADINGS`` and the directions of long sides. A plan begins at one place, so of several
    parts of the ground that are not joined that counts in which most can be worked. It asks less than a
    plan does: ways over ground that is still to be worked count, and so do bends between any two cells. What reaches
    up to half a cell too far is not seen: along walls, cells of 5 cm admit up to 0.7 % more than cells of 2 cm.
    """
    kept, tool, radius_m = drawn.ground.kept, drawn.tool, drawn.settings.smallest_radius_m
    low, high = np.split(np.array(shapely.total_bounds(kept)), 2)
    reach_m = max(math.hypot(a, b) for a in drawn.outline[:2] for b in drawn.outline[2:]) + LEAST_SWATH_M + 0.2
    low = low - reach_m
    columns, rows = (fft.next_fast_len(int(each), real=True) for each in np.ceil((high + reach_m - low) / cell_m))
    x, y = np.meshgrid(low[0] + cell_m * (np.arange(columns) + 0.5), low[1] + cell_m * (np.arange(rows) + 0.5))
    shapely.prepare(kept)
    shut = fft.rfft2((~shapely.contains_xy(kept, x, y)).astype(np.float32))
    field = shapely.Polygon(drawn.field.perimeter_m)
    shapely.prepare(field)
    inside = shapely.contains_xy(field, x, y)
    target = inside.copy()
    for ring in drawn.keep_outs_m:
        target &= ~shapely.contains_xy(shapely.Polygon(ring), x, y)
    headings = _ladder(kept)
    labels, offset = list[np.ndarray](), 0
    links = list[np.ndarray]()
    for number, heading in enumerate(headings):
        hit = fft.irfft2(
            shut * np.conj(_fine_kernel((rows, columns), *drawn.outline, heading, cell_m)), s=(rows, columns)
        )
        # Generous: what reaches beyond a cell's centre by less than half a cell is not seen.
        own, count = ndimage.label(hit < 0.5, structure=np.ones((3, 3)))
        own[own > 0] += offset
        offset += count
        labels.append(own)
        if number:
            links.append(_arcs(labels[-2], own, headings[number - 1], heading, radius_m, cell_m))
    links.append(_arcs(labels[-1], labels[0], headings[-1], headings[0] + 2.0 * math.pi, radius_m, cell_m))
    one, other = np.concatenate(links).T
    graph = sparse.coo_matrix((np.ones(len(one), bool), (one, other)), shape=(offset + 1, offset + 1))
    _, part = sparse.csgraph.connected_components(graph, directed=False)
    about = shapely.contains_xy(field.buffer(reach_m), x, y)
    counted = sum(np.bincount(own[about & (own > 0)], minlength=offset + 1) for own in labels)
    sizes = np.bincount(part, weights=counted)
    begins = np.zeros(len(sizes), bool)
    for own in labels:
        begins[part[np.flatnonzero(np.bincount(own[~inside]))]] = True
    begins[part[0]] = False
    best = np.zeros_like(target)
    candidates = [each for each in np.argsort(-sizes) if begins[each]][:_COMPONENTS]
    for each in candidates:
        reached = target & _swept(labels, headings, part == each, tool, cell_m)
        if np.count_nonzero(reached) > np.count_nonzero(best):
            best = reached
    return Bound(cell_m, low, target, best)


def _ladder(kept: shapely.Geometry) -> Float[np.ndarray, " heading"]:
    """Headings tried, ascending: equally spaced, and both ways along the longest sides."""
    found = list(_headings())
    starts, ends = [], []
    for polygon in shapely.get_parts(shapely.simplify(kept, 0.02)):
        for ring in (polygon.exterior, *polygon.interiors):
            corners = shapely.get_coordinates(ring)
            starts.append(corners[:-1])
            ends.append(corners[1:])
    sides = np.concatenate(ends) - np.concatenate(starts)
    lengths = np.hypot(*sides.T)
    added = 0
    for side in np.argsort(-lengths):
        angle = math.atan2(sides[side, 1], sides[side, 0])
        if lengths[side] < _LONG_SIDE_M or added == _MOST_SIDES:
            break
        if min(abs(math.remainder(angle - each, math.pi)) for each in found) > math.radians(1.0):
            found += [angle % (2.0 * math.pi), (angle + math.pi) % (2.0 * math.pi)]
            added += 1
    return np.sort(np.array(found))


def _fine_kernel(
    shape: tuple[int, int], front: float, rear: float, left: float, right: float, heading: float, cell_m: float
) -> np.ndarray:
    """Spectrum of the cells of a rectangle about the first cell."""
    whole = np.zeros(shape, np.float32)
    reach = math.ceil(max(math.hypot(a, b) for a in (front, rear) for b in (left, right)) / cell_m) + 1
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1] * cell_m
    ahead, aside = (
        column * math.cos(heading) + row * math.sin(heading),
        row * math.cos(heading) - column * math.sin(heading),
    )
    near = (ahead <= front) & (ahead >= rear) & (aside <= left) & (aside >= right)
    whole[: 2 * reach + 1, : 2 * reach + 1] = near
    return np.asarray(fft.rfft2(np.roll(whole, (-reach, -reach), axis=(0, 1))))


def _shift(ahead_m: float, heading: float, cell_m: float) -> tuple[int, int]:
    return round(ahead_m * math.sin(heading) / cell_m), round(ahead_m * math.cos(heading) / cell_m)


def _arcs(
    one: np.ndarray, other: np.ndarray, heading: float, after: float, radius_m: float, cell_m: float
) -> Int[np.ndarray, "link 2"]:
    """Parts of one heading and of the next that an arc of the smallest radius joins, in either gear."""
    turned = after - heading
    chord_m = 2.0 * radius_m * math.sin(0.5 * turned)
    pairs = []
    for gear in (1.0, -1.0):
        (row, other_row), (column, other_column) = (
            _overlap(*each)
            for each in zip(_shift(gear * chord_m, heading + 0.5 * turned, cell_m), one.shape, strict=True)
        )
        here, there = one[row, column], other[other_row, other_column]
        both = (here > 0) & (there > 0)
        found = np.stack([here[both], there[both]], axis=1)
        # Neighbours along a row mostly are of the same parts.
        pairs.append(found[(np.diff(found, axis=0, prepend=0) != 0).any(axis=1)])
    return np.concatenate(pairs)


def _overlap(by: int, count: int) -> tuple[slice, slice]:
    """Of an axis what has a place so many further on, and those places."""
    return slice(max(-by, 0), count - max(by, 0)), slice(max(by, 0), count - max(-by, 0))


def _swept(
    labels: Sequence[np.ndarray],
    headings: Float[np.ndarray, " heading"],
    counts: Bool[np.ndarray, " label"],
    tool: Tool,
    cell_m: float,
) -> Bool[np.ndarray, "row column"]:
    """Cells under the tool on straight ways forwards through poses that count."""
    shape = labels[0].shape
    total = np.zeros((), np.complex64)
    steps = round(LEAST_SWATH_M / cell_m)
    half_m = 0.5 * tool.width_m
    for own, heading in zip(labels, headings, strict=True):
        stands = counts[own]
        if not stands.any():
            continue
        leads = stands.copy()
        for step in range(1, steps + 1):
            (row, other_row), (column, other_column) = (
                _overlap(*each) for each in zip(_shift(step * cell_m, heading, cell_m), shape, strict=True)
            )
            # The border of the raster is never free.
            leads[row, column] &= stands[other_row, other_column]
        kernel = _fine_kernel(
            (shape[0], shape[1]),
            tool.ahead_m + 0.5 * tool.length_m + LEAST_SWATH_M,
            tool.ahead_m - 0.5 * tool.length_m,
            half_m,
            -half_m,
            heading,
            cell_m,
        )
        total = total + fft.rfft2(leads.astype(np.float32)) * kernel
    return np.asarray(fft.irfft2(total, s=shape) > 0.5) if total.shape else np.zeros(shape, bool)
