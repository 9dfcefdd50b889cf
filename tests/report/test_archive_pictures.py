"""Pictures and page of an archive: drawn whatever there is, and every number where it belongs."""

from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import numpy as np
from matplotlib.figure import Figure

from archive_records import done, failed, figures
from lgprjax.batch import sums_of
from lgprjax.report import (
    ArchiveDrives,
    ArchivePage,
    ArchivePlaces,
    ReportFigure,
    draw_archive_drives,
    draw_archive_places,
    write_archive_page,
)
from lgprjax.report.registered_folder import _drive_row, _failed_row, facts_of
from refusals import refused


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


def test_truth_adds_a_panel(tmp_path: Path, drawn: list[Figure]) -> None:
    for number, known in enumerate((True, False)):
        draw_archive_places(places(known=known), tmp_path / f"{number}.png")
    assert len(drawn[0].axes) > len(drawn[1].axes)


def test_maps_of_any_size_are_drawn(tmp_path: Path, drawn: list[Figure]) -> None:
    for cells, step in ((1, 1), (500, 40)):
        draw_archive_places(places(cells, step=step), tmp_path / f"{cells}.png")
        width, height = drawn[-1].get_size_inches()
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


def test_drives_with_and_without_truth_shares_and_times_are_drawn(tmp_path: Path, drawn: list[Figure]) -> None:
    share = np.where(np.arange(200) < 5, np.nan, 1.0)
    unknown = replace(drives(), ok_share=share, milliseconds_per_scan=np.full(200, np.nan))
    for number, shown in enumerate((drives(), drives(known=False), unknown)):
        draw_archive_drives(shown, tmp_path / f"{number}.png")
    assert len({len(figure.axes) for figure in drawn}) == 1
    with refused("output", "--force", file="0.png"):
        draw_archive_drives(drives(), tmp_path / "0.png")
    with refused("output", "--force", file="0.png"):
        draw_archive_places(places(), tmp_path / "0.png")


class Words(HTMLParser):
    """All text of a page, heading by heading."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.feed(text)

    def handle_data(self, data: str) -> None:
        self.words.append(data.replace("\xa0", " ").strip())


PLACE = ("1", "17.5, 2.5", "42.000000°", "100", "20.0 %", "0.400 m", "drive_7", "1.25")


def page(folder: Path, *, failed: bool, bad: bool, searched: bool = True) -> set[str]:
    """All texts of a page."""
    draw_archive_drives(drives(), folder / "spread.png", force=True)
    figure = ReportFigure(folder / "spread.png", "caption", "words")
    told = ArchivePage(
        title="Drives on a <road>",
        intro="Two.",
        facts=(("drives registered, failed", "2, 1"),),
        places=(PLACE,) if bad else (),
        drives=(("drive_1", "252", "90.0 %", "0", "0.020 m", "0.030 m", "0.100 m", "0.50"),),
        failed=(("drive_9", "drive_9.drive.h5: file: <cut>"),) if failed else (),
        workers=(("host:1", "2", "40", "0", "500 MB", "3.0 s"),),
        spread=figure if searched else None,
        plan=figure if searched else None,
    )
    write_archive_page(folder / "archive.html", told, force=True)
    return set(Words((folder / "archive.html").read_text(encoding="utf-8")).words)


def test_the_page_names_failures_and_places(tmp_path: Path) -> None:
    whole, good = page(tmp_path, failed=True, bad=True), page(tmp_path, failed=False, bad=False)
    assert {"Drives on a <road>", "drive_9.drive.h5: file: <cut>", *PLACE} <= whole
    assert not {"drive_9", *PLACE[1:4]} & good
    # That no place is bad is said, and not where nothing was searched.
    said = good - whole
    assert said
    assert not said & page(tmp_path, failed=True, bad=False, searched=False)


def test_a_failure_beside_a_kept_result_is_on_the_page() -> None:
    kept = done("a", figures({"ok": 3})).model_copy(update={"error": "a.drive.h5: file: cut"})
    records = [kept, failed("b", "b.drive.h5: file: gone"), done("c", figures({"ok": 2}))]
    rows = [_failed_row(record) for record in records if record.error]
    assert [name for name, _ in rows] == ["a", "b"]
    assert rows[0][1].startswith("a.drive.h5: file: cut")
    # Of the first an earlier result is kept, which is said.
    assert rows[0][1] != "a.drive.h5: file: cut"
    assert rows[1][1] == "b.drive.h5: file: gone"


def test_errors_that_nobody_judged_are_none() -> None:
    told = figures({"ok": 3}).model_copy(update={"wrong": 0})
    facts = dict(facts_of(sums_of([done("a", told)])))
    assert not any("wrong" in fact or "error" in fact for fact in facts)
    assert _drive_row(done("a", told))[3] == "–"
