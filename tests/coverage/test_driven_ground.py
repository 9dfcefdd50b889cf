"""A free plan driven in closed loop: every corner of body and tool, by the true pose, stays on the declared ground."""

from validation.fields.driven_ground import FLAIL, box, driven


def test_nothing_of_it_leaves_the_ground_where_two_sides_have_no_room() -> None:
    found = driven(*box(6.0, 3.0), FLAIL, lanes=1)
    print(f"6 x 3 m: {found.least_m.min():.3f} m within at least")
    assert (found.least_m > 0.1).all()
    assert (found.share == 1.0).all()
    assert not found.edge.any()
