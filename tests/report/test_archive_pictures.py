"""Pictures and page of an archive: drawn whatever there is, and every number where it belongs."""

from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.report import (
    ArchiveDrives,
    ArchivePage,
    ArchivePlaces,
    ReportFigure,
    draw_archive_drives,
    draw_archive_places,
    write_archive_page,
)


def places(cells: int = 30, *, known: bool = True, step: int = 1) -> ArchivePlaces:
    along = step * np.arange(cells)
    tried = np.full(cells, 100)
    ok = np.where(np.arange(cells) % 7 == 3, 20, 98)
    return ArchivePlaces(
        name="a road",
        cell_m=5.0,
        cell=np.stack([along, along // 20], axis=1),
        tried=tried,
        ok=ok,
        judged=ok if known else np.zeros(cells, np.int64),
        square_m2=ok * 0.05**2 if known else np.zeros(cells),
        worst_m=np.array([[17.5, 2.5], [52.5, 2.5]]),
        chords_m=np.array([[[0.0, 2.0], [5.0 * along[-1], 5.0 * along[-1] / 20]]]),
    )


def drives(*, known: bool = True) -> ArchiveDrives:
    rng = np.random.default_rng(1)
    error = 0.02 + 0.01 * rng.random(200) if known else np.full(200, np.nan)
    return ArchiveDrives(
        name="a road",
        ok_share=np.clip(0.95 + 0.05 * rng.standard_normal(200), 0.0, 1.0),
        rms_cross_m=error,
        rms_along_m=1.5 * error,
        milliseconds_per_scan=0.5 + 0.1 * rng.random(200),
        counts={"ok": 9500, "low_correlation": 400, "edge": 100, "no_window": 7},
    )


def size(path: Path) -> tuple[int, ...]:
    return tuple(matplotlib.image.imread(path).shape[:2])


def test_truth_adds_a_panel(tmp_path: Path) -> None:
    draw_archive_places(places(), tmp_path / "with.png")
    draw_archive_places(places(known=False), tmp_path / "without.png")
    assert size(tmp_path / "with.png")[0] > 1.5 * size(tmp_path / "without.png")[0]


@pytest.mark.parametrize(("cells", "step"), [(1, 1), (3, 1), (500, 40)])
def test_maps_of_any_size_are_drawn(cells: int, step: int, tmp_path: Path) -> None:
    draw_archive_places(places(cells, step=step), tmp_path / "plan.png")
    height, width = size(tmp_path / "plan.png")
    assert 0.2 * width < height < 3.0 * width


def test_cells_of_a_bad_share_stand_apart(tmp_path: Path) -> None:
    """One bad cell among good ones changes the picture where it is, and only there."""
    good = places(12, known=False)
    bare = {"worst_m": np.zeros((0, 2)), "chords_m": np.zeros((0, 2, 2))}
    good = ArchivePlaces(**{**vars(good), "ok": good.tried, **bare})
    bad = ArchivePlaces(**{**vars(good), "ok": np.where(np.arange(12) == 6, 0, 100)})
    draw_archive_places(good, tmp_path / "good.png")
    draw_archive_places(bad, tmp_path / "bad.png")
    one, other = (matplotlib.image.imread(tmp_path / name) for name in ("good.png", "bad.png"))
    changed = np.any(one != other, axis=2)
    columns = np.flatnonzero(changed.any(axis=0))
    assert changed.any()
    assert np.ptp(columns) < 0.12 * one.shape[1]


def test_drives_with_and_without_truth_are_drawn(tmp_path: Path) -> None:
    draw_archive_drives(drives(), tmp_path / "with.png")
    draw_archive_drives(drives(known=False), tmp_path / "without.png")
    assert size(tmp_path / "with.png") == size(tmp_path / "without.png")
    with pytest.raises(InputError, match="one that exists"):
        draw_archive_drives(drives(), tmp_path / "with.png")


class Words(HTMLParser):
    """All text of a page, heading by heading."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.feed(text)

    def handle_data(self, data: str) -> None:
        self.words.append(data.replace("\xa0", " ").strip())


def page(tmp_path: Path, *, failed: tuple[tuple[str, str], ...], bad: tuple[tuple[str, ...], ...]) -> list[str]:
    draw_archive_drives(drives(), tmp_path / "spread.png", force=True)
    figure = ReportFigure(tmp_path / "spread.png", "caption", "words")
    told = ArchivePage(
        title="Drives on a <road>",
        intro="Two.",
        facts=(("drives registered, failed", "2, 1"),),
        places=bad,
        drives=(("drive_1", "252", "90.0 %", "0", "0.020 m", "0.030 m", "0.100 m", "0.50"),),
        failed=failed,
        workers=(("host:1", "2", "40", "0", "500 MB", "3.0 s"),),
        spread=figure,
        plan=None,
    )
    write_archive_page(tmp_path / "archive.html", told, force=True)
    return Words((tmp_path / "archive.html").read_text(encoding="utf-8")).words


def test_the_page_names_failures_and_places(tmp_path: Path) -> None:
    place = ("1", "17.5, 2.5", "42.000000°, -71.000000°", "100", "20.0 %", "0.400 m", "drive_7", "1.25")
    words = page(tmp_path, failed=(("drive_9", "drive_9.drive.h5: file: <cut>"),), bad=(place,))
    assert "Drives on a <road>" in words
    assert "Drives that failed" in words
    assert "drive_9.drive.h5: file: <cut>" in words
    for text in place:
        assert text in words
    assert not any("No place" in word for word in words)


def test_a_page_without_bad_places_says_so(tmp_path: Path) -> None:
    words = page(tmp_path, failed=(), bad=())
    assert "Drives that failed" not in words
    assert "No place with a scan that lacks a correct fix." in words
