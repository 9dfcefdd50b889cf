"""Pictures and page of an archive: drawn whatever there is, and every number where it belongs."""

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from archive_records import done, failed, figures
from lgprjax.batch import sums_of
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
from lgprjax.report.registered_folder import _drive_row, _failed_row, _intro, facts_of


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


def page(
    tmp_path: Path,
    *,
    failed: tuple[tuple[str, str], ...],
    bad: tuple[tuple[str, ...], ...],
    searched: bool = True,
) -> list[str]:
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
        spread=figure if searched else None,
        plan=figure if searched else None,
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


def test_where_nothing_was_searched_no_place_is_called_good(tmp_path: Path) -> None:
    words = page(tmp_path, failed=(("drive_9", "gone"),), bad=(), searched=False)
    assert "No scan was searched." in words
    assert not any("No place" in word for word in words)


def test_unknown_shares_and_times_of_drives_are_left_out(tmp_path: Path) -> None:
    share = np.where(np.arange(200) < 5, np.nan, 1.0)
    known = replace(drives(), ok_share=share, milliseconds_per_scan=np.full(200, np.nan))
    draw_archive_drives(known, tmp_path / "spread.png")
    draw_archive_drives(drives(), tmp_path / "all.png")
    assert size(tmp_path / "spread.png") == size(tmp_path / "all.png")


def test_a_failure_beside_a_kept_result_is_on_the_page() -> None:
    kept = done("a", figures({"ok": 3})).model_copy(update={"error": "a.drive.h5: file: cut"})
    records = [kept, failed("b", "b.drive.h5: file: gone"), done("c", figures({"ok": 2}))]
    rows = [_failed_row(record) for record in records if record.error]
    assert rows == [
        ("a", "a.drive.h5: file: cut; the result of an earlier run is kept"),
        ("b", "b.drive.h5: file: gone"),
    ]


def test_nothing_is_said_of_a_search_where_all_drives_failed() -> None:
    assert _intro([failed("b", "gone")]) == "No drive could be registered."


def test_errors_that_nobody_judged_are_none() -> None:
    told = figures({"ok": 3}).model_copy(update={"wrong": 0})
    facts = dict(facts_of(sums_of([done("a", told)])))
    assert not any("wrong" in fact or "error" in fact for fact in facts)
    assert _drive_row(done("a", told))[3] == "–"
