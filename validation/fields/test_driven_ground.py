"""Free plans of a larger field and of drawn ones, driven in closed loop: every corner stays on the declared ground."""

from collections.abc import Callable

import pytest

from lgprjax.coverage.tour import plan_tour
from validation.fields.driven_ground import FLAIL, Flail, box, driven
from validation.fields.random_fields import draw_field


@pytest.mark.parametrize("base_m", [None, 0.1])
def test_nothing_of_it_leaves_the_ground_of_30_by_20_m(
    base_m: float | None, record_property: Callable[[str, object], None]
) -> None:
    """By other laws the base is off by up to 10 cm, which no filter sees: so much nearer the wall it may be."""
    found = driven(*box(30.0, 20.0), FLAIL, lanes=4, base_m=base_m)
    record_property("driven", found.told())
    assert (found.least_m > 0.0).all()


@pytest.mark.parametrize("seed", [12, 33])
def test_nothing_of_it_leaves_the_ground_of_drawn_fields(
    seed: int, record_property: Callable[[str, object], None]
) -> None:
    drawn = draw_field(seed)
    assert len(drawn.keep_outs_m) >= 2
    tour = plan_tour(
        drawn.field, drawn.ground, drawn.keep_outs_m, drawn.settings, drawn.tool, drawn.outline, name=f"seed {seed}"
    )
    flail = Flail(drawn.tool, drawn.outline, drawn.settings.smallest_radius_m, 0.9 * drawn.tool.width_m)
    found = driven(tour.pattern, drawn.ground, flail, lanes=2)
    record_property("driven", found.told())
    assert (found.least_m > 0.0).all()
