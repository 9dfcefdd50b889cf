"""Parts of the ground that a vehicle cannot get from one to another of.

A part is a set of poses: places at a ladder of headings, joined where neighbouring poses both fit. A plan begins at one
place, so it is for one part: that in which most can be worked, of those that can be come into from beyond what is to be
worked. Turning on the spot and sliding sideways cost nothing in it, so what it sets apart no way joins.
"""

import math

import numpy as np
from jaxtyping import Bool, Int
from scipy import ndimage, sparse

from lgprjax.coverage.field import Tool
from lgprjax.coverage.joints import Terrain, cells_under

_EVERY = 2
"""Cells of the terrain for one of the parts."""
_MOST_PARTS = 4
"""Largest ones that are compared."""


def workable_cells(terrain: Terrain, tool: Tool) -> Bool[np.ndarray, "row column"]:
    """Cells that the tool can cover while the vehicle stays in the part in which most of the target can be worked.

    Parts with a pose off the target are preferred; if nothing can be worked from one, the vehicle has to be brought
    onto the field.

    Args:
        terrain: raster of the ground and of the target.
        tool: working tool.
    """
    cell_m = _EVERY * terrain.cell_m
    # A place may be between two cells of the raster: cells excluded here are excluded for certain.
    stands = terrain.standing(terrain.ground.clearance_m - math.sqrt(0.5) * cell_m, every=_EVERY)
    part = _parts(stands)
    target = terrain.target[::_EVERY, ::_EVERY]
    sizes = np.bincount(part.ravel())
    outside = np.bincount(part[:, ~target].ravel(), minlength=len(sizes)) > 0
    sizes[0] = 0
    least = tool.width_m * tool.length_m / cell_m**2
    best = np.zeros_like(target)
    for among in (outside, ~outside):
        numbers = np.flatnonzero(among & (sizes > 0))
        for each in numbers[np.argsort(-sizes[numbers], kind="stable")][:_MOST_PARTS]:
            over = cells_under(part == each, tool, cell_m)
            if np.count_nonzero(over & target) > np.count_nonzero(best & target):
                best = over
        if np.count_nonzero(best & target) > least:
            break
    rows, columns = terrain.target.shape
    fine: Bool[np.ndarray, "row column"] = best.repeat(_EVERY, axis=0).repeat(_EVERY, axis=1)[:rows, :columns]
    return fine


def _parts(stands: Bool[np.ndarray, "heading row column"]) -> Int[np.ndarray, "heading row column"]:
    """Number of the part of each pose, from 1; the last heading is next to the first."""
    labels, count = ndimage.label(stands, structure=np.ones((3, 3, 3)))
    first, last = labels[0], labels[-1]
    both = (first > 0) & (last > 0)
    graph = sparse.coo_matrix((np.ones(int(both.sum()), bool), (first[both], last[both])), shape=(count + 1, count + 1))
    joined = sparse.csgraph.connected_components(graph, directed=False)[1] + 1
    # Cells of no part keep number 0.
    joined[0] = 0
    numbers: Int[np.ndarray, "heading row column"] = joined[labels]
    return numbers
