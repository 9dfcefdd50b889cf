"""A million bytes of frames, garbage and lies over each kind of line."""

from collections.abc import Callable

import pytest

from validation.damage.line_storm import check_gnss, check_line


@pytest.mark.parametrize("line", ["radar", "drive_by_wire", "controller"])
def test_nothing_wrong_is_acted_upon(line: str, record_property: Callable[[str, object], None]) -> None:
    record_property("accepted", check_line(line, 1_000_000))


def test_gnss_messages_with_a_wrong_checksum_are_never_read(record_property: Callable[[str, object], None]) -> None:
    record_property("whole", check_gnss(1_000_000))
