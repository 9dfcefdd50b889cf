"""A world made by another program, drawn far from the site of the other tests: located, its impostor refused."""

from validation.worlds.figures import world_figures
from validation.worlds.small import SMALL_WORLDS


def test_a_small_world_is_located_and_its_impostor_is_not() -> None:
    """Thirty of them on eight days: ``make validation NAME=worlds``."""
    world = SMALL_WORLDS[0]
    rows = {row.day: row for row in world_figures(world, ["clear", "impostor"])}
    assert min(row.scans for row in rows.values()) > 100
    assert rows["clear"].ok_share >= 0.9
    assert rows["clear"].wrong == 0
    assert rows["clear"].largest_along_m < 0.1
    assert rows["impostor"].ok == 0
