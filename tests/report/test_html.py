"""The page: well formed, whole in one file, safe from what names contain."""

import base64
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import quote

import pytest

from lgprjax.report import (
    ReportFigure,
    ReportTable,
    Section,
    draw_surface,
    drive_section,
    overview_table,
    summarise,
    write_report,
)
from lgprjax.report.zoom_page import write_drive_page
from refusals import refused
from report.synthetic import correlation_surface, declined_drive, numbers, straight_drive, without_truth

VOID = {"meta", "img", "br", "link", "input"}


class Page(HTMLParser):
    """Collects what the tests ask for and holds that every element closes in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.images: list[dict[str, str | None]] = []
        self.tags: list[str] = []
        self.ids: set[str] = set()
        self.links: list[str] = []
        self.words: list[str] = []
        self.feed(text)
        self.close()
        assert not self.open

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        values = dict(attrs)
        self.ids.add(values.get("id") or "")
        if tag == "img":
            self.images.append(values)
        if tag == "a":
            self.links.append(values["href"] or "")
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.append(data)


@pytest.fixture(scope="module")
def picture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("pictures") / "surface.png"
    draw_surface(correlation_surface(), path)
    return path


def test_page_holds_every_figure_and_table(tmp_path: Path, picture: Path) -> None:
    drives = [straight_drive(), without_truth(), declined_drive()]
    summaries = [summarise(drive) for drive in drives]
    figure = ReportFigure(picture, "Seen from above.", "Correlation over position")
    sections = [Section("Overview", "All drives.\n\nAgainst one map.", (overview_table(summaries),))]
    sections += [drive_section(s, [figure, figure]) for s in summaries]
    write_report(tmp_path / "r.html", "Report", "First.\n\nSecond.", sections)
    text = (tmp_path / "r.html").read_text(encoding="utf-8")
    page = Page(text)
    assert len(page.images) == 6
    for image in page.images:
        assert image["alt"] == "Correlation over position"
        scheme, data = (image["src"] or "").split(",")
        assert scheme == "data:image/png;base64"
        assert base64.b64decode(data) == picture.read_bytes()
    # Each can be looked at more closely, also by the keyboard.
    assert page.tags.count("input") == page.tags.count("label") == 6
    assert page.tags.count("table") == 4
    assert page.tags.count("figcaption") == 6
    beside = {f"{quote(summary.name)}-scans.html" for summary in summaries}
    assert {link.removeprefix("#") for link in page.links} - beside <= page.ids
    assert beside <= set(page.links)
    assert "script" not in page.tags
    assert "http" not in text


def test_sections_say_what_kind_of_drive_it_was() -> None:
    texts = [
        drive_section(summarise(drive), ()).text
        for drive in (straight_drive(), without_truth(), declined_drive(), declined_drive(impostor=False))
    ]
    assert "0.3 m" in texts[0]
    assert "0.3 m" not in texts[1]
    assert {"0", "200"} <= set(numbers(texts[2]))
    assert len(set(texts)) == 4


def test_names_cannot_become_markup(tmp_path: Path, picture: Path) -> None:
    evil = '<b onclick="x">&amp;'
    section = Section(evil, evil, (ReportTable((evil,), ((evil, evil),), evil),), (ReportFigure(picture, evil, evil),))
    write_report(tmp_path / "r.html", evil, evil, [section])
    page = Page((tmp_path / "r.html").read_text(encoding="utf-8"))
    assert "b" not in page.tags
    assert page.images[0]["alt"] == evil
    assert sum(word.strip() == evil for word in page.words) == 11


def test_existing_page_is_refused_without_force(tmp_path: Path) -> None:
    target = tmp_path / "r.html"
    target.write_text("mine")
    with refused("output", "--force", file="r.html"):
        write_report(target, "t", "", [])
    assert target.read_text() == "mine"
    write_report(target, "t", "", [], force=True)
    assert Page(target.read_text()).tags.count("h1") == 1
    # A missing picture leaves no page.
    section = Section("s", figures=(ReportFigure(tmp_path / "none.png", "c", "a"),))
    with pytest.raises(FileNotFoundError):
        write_report(tmp_path / "other.html", "t", "", [section])
    assert list(tmp_path.iterdir()) == [target]


def test_a_long_drive_is_thinned_but_counts_and_wrong_fixes_are_whole(tmp_path: Path) -> None:
    drive = straight_drive(30_000)
    scan = 101  # odd, an ok one
    drive.east_m[scan] += 5.0
    write_drive_page(drive, tmp_path / "scans.html")
    text = (tmp_path / "scans.html").read_text(encoding="utf-8")
    found = re.search(r'id="data">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    scans = json.loads(found[1].replace("<\\/", "</"))["scans"]
    counts = {code: count for code, count in summarise(drive).counts.items() if count}
    assert {code: count for code, _, _, count in scans["codes"]} == counts
    assert len(scans["code"]) == 15_001
    assert scan in scans["columns"][0][1]
    assert "30000" in text
