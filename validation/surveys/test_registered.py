"""The real recordings, imported as their owners would and registered by default. Figures: docs/records/real.json."""

from collections.abc import Callable
from pathlib import Path

import pytest

from lgprjax.formats import import_lines
from lgprjax.mapping import build_map
from validation.surveys.registered import WINDOWS, Row, hautefeuille, judge, parallel_lines, register, single_lines


@pytest.fixture
def shown(record_property: Callable[[str, object], None]) -> Callable[[Row], Row]:
    """Keeps a row's figures in the record of the validation."""

    def keep(row: Row) -> Row:
        for name in ("tried", "ok", "right"):
            record_property(f"{row.name}: {name}", getattr(row, name))
        return row

    return keep


def test_parallel_lines_are_found_between_the_lines_of_the_map(
    real_data: Path, tmp_path: Path, shown: Callable[[Row], Row]
) -> None:
    (row,) = map(shown, parallel_lines(real_data, tmp_path))
    assert row.tried >= 330
    # Lines of 11.6 m with a wavelength of a metre: half of each is driven before there is certainty, and the place is
    # carried back over it.
    assert row.ok >= 0.95 * row.tried
    assert row.right >= 0.995 * row.ok


def test_a_line_beside_the_map_is_not_lied_about(real_data: Path, tmp_path: Path, shown: Callable[[Row], Row]) -> None:
    (row,) = map(shown, hautefeuille(real_data, tmp_path))
    assert row.tried > 30
    assert row.ok == 0


@pytest.mark.parametrize(("name", "least"), [("Yosemite", 0.9), ("dune", 0.95)])
def test_odd_and_even_traces_of_a_line(
    name: str, least: float, real_data: Path, tmp_path: Path, shown: Callable[[Row], Row]
) -> None:
    """Yosemite: 50 MHz, a trace each two feet, so that map and live traces lie 1.22 m apart, half a step off."""
    (row,) = map(shown, single_lines(real_data, tmp_path, only=name))
    assert row.tried > 200
    assert row.right >= 0.99 * row.ok
    assert row.ok >= least * row.tried


def test_another_days_lines(real_data: Path, tmp_path: Path, shown: Callable[[Row], Row]) -> None:
    """Flagogna: a line of the next day, antennas turned about and walked back, 0.25 m beside the map's rim; 1.0 m
    beside it, the ground resembles the rim and must be declined."""
    lines = {number: real_data / "flagogna" / f"XLINE{number:03d}.DT1" for number in range(50, 71)}
    import_lines([lines[number] for number in range(50, 67)], output=tmp_path / "map.drive.h5")
    build_map([tmp_path / "map.drive.h5"], tmp_path / "m.map.h5")
    rows = {}
    for number in (67, 70):
        drive = tmp_path / f"{number}.drive.h5"
        import_lines([lines[number]], output=drive)
        # The labels of the two days themselves differ by half a metre over the first 20 m of these lines.
        rows[number] = shown(judge(str(number), [register(tmp_path / "m.map.h5", drive, WINDOWS)], 0.7))
    assert rows[67].ok >= 0.7 * rows[67].tried
    assert rows[67].right == rows[67].ok
    assert "inverted" in rows[67].told
    assert "driven in the opposite direction" in rows[67].told
    assert rows[70].tried > 150
    assert rows[70].ok == 0
