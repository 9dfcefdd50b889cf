"""An array whose middle is beside its single baseline by half its width."""

from pathlib import Path

from validation.worlds.beside import beside


def test_half_an_array_on_the_map_is_located(tmp_path: Path) -> None:
    """Half a metre to a metre of 1.4 m lies on the map: on the table's grounds 80 % are asked at 0.7 m, none wrong."""
    (found,) = beside(3, (0.7,), tmp_path, length_m=28.0)
    assert found.wrong == 0
    assert found.ok >= 0.8
