"""The pictures of the documentation are those of today's sources."""

from pathlib import Path

from pictures import digest
from pictures.catalogue import MEASURED, PICTURES

COMMAND = "make pictures, or python -m pictures NAME..."
_DRAWN = (".png", ".svg", ".webp")


def test_no_picture_is_out_of_date() -> None:
    old = digest.stale({name: picture.sources for name, picture in PICTURES.items()})
    assert old == [], f"out of date: {', '.join(old)}; draw them: {COMMAND}"


def test_every_picture_has_a_command() -> None:
    there = {path.name for path in digest.FOLDER.iterdir() if path.suffix in _DRAWN}
    assert there == {*PICTURES, *MEASURED}
    assert set(digest.read_record()) == set(PICTURES)


def test_pictures_are_small() -> None:
    large = {path.name: path.stat().st_size for path in digest.FOLDER.iterdir() if path.stat().st_size > 2_500_000}
    assert large == {}


def test_words_do_not_count(tmp_path: Path) -> None:
    first, second = tmp_path / "a.py", tmp_path / "b.py"
    first.write_text('"""One."""\n\nA = "text"  # why\n', encoding="utf-8")
    second.write_text('"""Two\n\nmore."""\n# A comment.\nA = "text"  # why\n', encoding="utf-8")
    assert digest._content(first) == digest._content(second)
    second.write_text('"""One."""\nA = "other"  # why\n', encoding="utf-8")
    assert digest._content(first) != digest._content(second)
