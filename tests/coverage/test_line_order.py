"""The order of lines in closed form, and the parts of concave fields."""

from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.coverage.swaths import Order, chains, line_order, lines_for_zamboni, middle_line


def smallest_step(count: int, order: Order) -> int:
    """Fewest line spacings between two lines driven one after the other."""
    return min((abs(after - before) for before, after in pairwise(line_order(count, order))), default=0)


def test_zamboni_order_is_first_middle_second_next_to_the_middle() -> None:
    for driven in ([1], [1, 2], [1, 3, 2], [1, 5, 2, 6, 3, 7, 4, 8], [1, 6, 2, 7, 3, 8, 4, 9, 5]):
        assert [number + 1 for number in line_order(len(driven), "zamboni")] == driven
        assert [number + 1 for number in line_order(len(driven), "boustrophedon")] == list(range(1, len(driven) + 1))


@settings(deadline=None, max_examples=15)
@given(count=st.integers(3, 400))
def test_zamboni_order_drives_every_line_once_with_turns_of_about_half_the_width(count: int) -> None:
    order = line_order(count, "zamboni")
    assert sorted(order) == list(range(count))
    half = middle_line(count) - 1
    assert [after - before for before, after in pairwise(order)] == [half, 1 - half] * ((count - 1) // 2) + [half] * (
        (count - 1) % 2
    )
    assert abs(half - count / 2) <= 0.5
    assert smallest_step(count, "zamboni") == (count // 2 - 1 if count % 2 == 0 else (count - 1) // 2)
    assert smallest_step(count, "boustrophedon") == 1


@settings(deadline=None, max_examples=15)
@given(radius_m=st.floats(0.2, 20.0), spacing_m=st.floats(0.3, 3.0))
def test_the_number_of_lines_that_would_do_is_the_smallest(radius_m: float, spacing_m: float) -> None:
    count = lines_for_zamboni(radius_m, spacing_m)
    assert smallest_step(count, "zamboni") * spacing_m >= 2.0 * radius_m * (1.0 - 1e-8)
    assert count == 2 or smallest_step(count - 1, "zamboni") * spacing_m < 2.0 * radius_m


def test_a_convex_field_is_one_part_and_a_concave_one_falls_apart_where_it_branches() -> None:
    one = chains([[(0.0, 5.0)], [(0.0, 9.0)], [(4.0, 9.0)]])
    assert [[piece.strip for piece in chain] for chain in one] == [[0, 1, 2]]
    # A foot, two legs, a lintel: what a field around a pond looks like.
    ring = chains([[(0.0, 9.0)], [(0.0, 3.0), (6.0, 9.0)], [(0.0, 3.0), (6.0, 9.0)], [(0.0, 9.0)]])
    assert [[piece.strip for piece in chain] for chain in ring] == [[0], [1, 2], [1, 2], [3]]
    assert [chain[0].span_m for chain in ring] == [(0.0, 9.0), (0.0, 3.0), (6.0, 9.0), (0.0, 9.0)]
    # A strip without ground parts what lies before it from what lies after.
    assert len(chains([[(0.0, 5.0)], [], [(0.0, 5.0)]])) == 2
