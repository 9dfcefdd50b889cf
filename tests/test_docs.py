"""The pages: tutorial and how-to pages run in their order in an empty folder, links lead somewhere, the site needs no
network."""

import contextlib
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pyogrio
import pytest
from rosbags.highlevel import AnyReader

from benchmarks.__main__ import Name
from benchmarks.page import ABOUT, filled_page, record_pages
from benchmarks.records import Record
from canon.map import built_with_many_grounds
from formats.mcap_sample import curved_fixes, write_curved
from formats.samples import write_dt1
from formats.test_signal_tables import columns, write_csv
from lgprjax.formats import DriveLog, TraceRecording, export_mcap, read_fixes
from lgprjax.simulation import read_site
from runtime.display.browser import open_tab
from shown_commands import HOW_TO, TUTORIAL, follow, marked_blocks, python_of
from validation.worlds.table import markdown_of, read_figures
from word_checks import idioms_in, sentences_of

_ROOT = Path(__file__).parents[1]
_PAGES = sorted([*(_ROOT / "docs").glob("*.md"), *_ROOT.glob("*.md"), *_ROOT.glob("[a-z]*/README.md")])
_LINK = re.compile(r"\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


def _anchor(heading: str) -> str:
    return re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")


def test_links_lead_to_files_and_headings() -> None:
    for page in _PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        for link in _LINK.findall(text):
            if link.startswith(("http:", "https:")):
                continue
            path, _, anchor = link.partition("#")
            target = (page.parent / path).resolve() if path else page
            assert target.exists(), f"{page.name}: {link}"
            if anchor:
                headings = map(_anchor, _HEADING.findall(target.read_text(encoding="utf-8")))
                assert anchor in headings, f"{page.name}: {link}"


def test_pages_are_short_and_plain() -> None:
    """Limits that were set for the documentation: words, idioms (``word_checks``), pictures."""
    texts = {page: page.read_text(encoding="utf-8") for page in _PAGES}
    for page, text in texts.items():
        idioms = idioms_in(text)
        assert len(idioms) <= 0.03 * len(sentences_of(text)), (page, idioms)
        assert len(text.split()) <= 3000, page
    of_docs = [text for page, text in texts.items() if page.parent.name == "docs"]
    assert sum(len(text.split()) for text in of_docs) <= 45_000
    assert len(texts[_ROOT / "README.md"].splitlines()) <= 130
    pictures = {name for text in of_docs for name in re.findall(r"!\[[^\]]+\]\(pictures/([^)]+)\)", text)}
    assert len(pictures) >= 30


def _lines_of_a_drive(drive: Path, folder: Path) -> None:
    """The reader's own files: each channel of a drive as a line of its own, as a single antenna would record it."""
    with DriveLog.open(drive) as log:
        recording = log.description.recording
        assert isinstance(recording, TraceRecording)
        traces, _ = log.read_traces(0, log.scans)
        odometry = log.description.odometry
        travel_m = np.interp(log.scan_time_s, odometry.time_s, odometry.distance_m)
    for channel in range(traces.shape[1]):
        write_dt1(
            folder / f"LINE{channel + 1:02d}.DT1",
            (100.0 * traces[:, channel]).astype(np.int16),
            step=float(np.ptp(travel_m)) / (len(traces) - 1),
            TOTAL_TIME_WINDOW=traces.shape[2] * recording.sample_interval_ns,
            TIMEZERO_AT_POINT=recording.time_zero_ns / recording.sample_interval_ns,
            NOMINAL_FREQUENCY=(recording.centre_frequency_hz or 250e6) / 1e6,
        )


@pytest.fixture(scope="module")
def tutorial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder in which all of the tutorial's blocks were run, in their order."""
    folder = tmp_path_factory.mktemp("tutorial")
    blocks = marked_blocks(TUTORIAL)
    assert len(blocks) >= 5
    with contextlib.chdir(folder), built_with_many_grounds():
        for number, block in enumerate(blocks):
            follow(*block)
            if number == 0:
                _lines_of_a_drive(folder / "drives" / "baseline.drive.h5", folder)
    return folder


def test_the_tutorials_drive_is_found_and_the_one_elsewhere_is_not(tutorial: Path) -> None:
    live, elsewhere = (read_fixes(tutorial / "result" / f"{name}.fixes.h5") for name in ("live", "elsewhere"))
    tried = live["code"] != "no_window"
    assert (live["code"] == "ok").sum() > 0.5 * tried.sum()
    assert not (elsewhere["code"] == "ok").any()
    assert (tutorial / "result" / "report.html").is_file()


def test_the_tutorials_lines_are_found_between_each_other(tutorial: Path) -> None:
    pictures = {path.name for path in (tutorial / "pictures").iterdir()}
    assert pictures == {"LINE01.png", "odd.drive.png", "lines.map.png"}
    fixes = read_fixes(tutorial / "lines-result" / "even.fixes.h5")
    tried = fixes["code"] != "no_window"
    assert (fixes["code"] == "ok").sum() > 0.5 * tried.sum()


def test_the_tutorials_recording_is_the_drive(tutorial: Path) -> None:
    with DriveLog.open(tutorial / "drives" / "live.drive.h5") as old, DriveLog.open(tutorial / "again.drive.h5") as new:
        assert new.scans == old.scans
        np.testing.assert_array_equal(new.read_stored(0, 5)[0], old.read_stored(0, 5)[0])


def test_the_reference_names_modules_that_there_are() -> None:
    """``make docs`` is not part of these tests; a room that moved is noticed here."""
    hooks = (_ROOT / "mkdocs_hooks.py").read_text(encoding="utf-8")
    names = re.findall(r'"([a-z_.]+)"', hooks[hooks.index("_ROOMS = (") :].split("\n)", 1)[0])
    assert len(names) > 15
    assert [name for name in names if find_spec(f"lgprjax.{name}") is None] == []


def test_records_are_those_of_a_benchmark_and_say_whether_goals_are_met() -> None:
    paths = sorted((_ROOT / "docs" / "records").glob("*.json"))
    assert paths
    for path in paths:
        told = json.loads(path.read_text(encoding="utf-8"))
        other = told.get("command", "").startswith(("python -m validation.worlds.", "python -m validation.surveys."))
        assert other or path.stem.removeprefix("gpu_") in get_args(Name), path
        assert "cores" in told["machine"]
        for kept in told["records"]:
            record = Record(**{key: value for key, value in kept.items() if key != "met"})
            assert record.met == kept["met"], path


def test_the_targets_of_the_page_are_those_of_the_records() -> None:
    """``python -m benchmarks.page`` writes them."""
    page = (_ROOT / "docs" / "performance.md").read_text(encoding="utf-8")
    assert page.count("](records/") >= 13
    assert filled_page(page, _ROOT / "docs" / "records") == page


def _told(path: Path) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return told


def test_every_record_has_a_page_with_all_of_its_figures() -> None:
    folder = _ROOT / "docs" / "records"
    pages = record_pages(folder)
    paths = sorted(folder.glob("*.json"))
    assert set(pages) == {"index.md", *(path.with_suffix(".md").name for path in paths)}
    for path in paths:
        told, page = _told(path), pages[f"{path.stem}.md"]
        assert path.stem in ABOUT
        assert f"({path.stem}.md)" in pages["index.md"]
        for fact in ("command", "date", "commit", "machine"):
            assert str(told.get(fact, "not recorded")) in page
        sections = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
        by_key, (head, *rows) = _cells(sections.get("Figures", "")), _cells(sections.get("Figures by condition", "|"))
        shown = {key: f"**{value}**" if met == "**no**" else value for key, value, _, _, met, _ in by_key}
        for condition, *cells in rows:
            for name, cell in zip(head[1:], cells, strict=True):
                # With and without a unit behind the last comma.
                shown |= dict.fromkeys((f"{condition}: {name}", f"{condition}: {name.rpartition(',')[0]}"), cell)
        for record in told["records"]:
            cell, value = shown[record["key"]], record["value"]
            assert ("**" in cell) is (record["met"] is False), record["key"]
            if value is not None:
                assert float(cell.strip("*")) == pytest.approx(value, rel=6e-3), record["key"]


def _cells(table: str) -> list[list[str]]:
    """Rows of the tables in a text, without the lines below their heads."""
    lines = [line for line in table.splitlines() if line.startswith("|") and not line.startswith("| ---")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_a_page_of_a_record_marks_what_misses_and_what_was_not_recorded(tmp_path: Path) -> None:
    figures = [("speed", 3.0, 4.0, False), ("share", 5.0, 4.0, True), ("load", None, None, None)]
    records = [
        {"key": key, "value": value, "unit": "m/s", "direction": "higher", "goal": goal, "note": "", "met": met}
        for key, value, goal, met in figures
    ]
    path = tmp_path / "some-runs.json"
    path.write_text(json.dumps({"machine": "2 cores", "quick": True, "records": records}), encoding="utf-8")
    page = record_pages(tmp_path)["some-runs.md"]
    assert page.startswith("# Some runs\n")
    assert "- Date: not recorded\n- Commit: not recorded\n- Machine: 2 cores\n" in page
    assert "| speed | ≥ 4 m/s | **0 of 1** | **3 m/s** |" in page
    assert "| share | ≥ 4 m/s | 1 of 1 | 5 m/s |" in page
    assert "| speed | 3 | m/s | ≥ 4 | **no** |  |" in page
    assert "few repetitions" in page
    row = "| [Some runs](records/some-runs.json) | 1 of 2 | **speed: 3 m/s (≥ 4 m/s)** |"
    assert row in filled_page("<!-- targets -->\n<!-- end -->", tmp_path)
    told = json.loads(path.read_text(encoding="utf-8")) | {"date": "2026-01-02", "commit": "abc1234", "quick": False}
    path.write_text(json.dumps(told), encoding="utf-8")
    pages = record_pages(tmp_path, {"some-runs": "a table"})
    assert "| not recorded | 2026-01-02 | abc1234 | 1 | **1** |" in pages["index.md"]
    assert "## Summary\n\na table\n" in pages["some-runs.md"]
    assert "few repetitions" not in pages["some-runs.md"]


def test_the_tables_of_the_worlds_are_those_of_their_record() -> None:
    path = _ROOT / "docs" / "records" / "worlds.json"
    rows = {line.split(" | ")[0].strip("| *"): line for line in markdown_of(read_figures(path)).splitlines()}
    figures = [each for each in _told(path)["figures"] if each["day"] not in ("impostor", "lookalike")]
    assert len(figures) > 150
    for each in figures:
        assert f"| {100 * each['ok'] / each['scans']:.1f} |" in rows[str(each["world"])]
    clear = [each["pieces"] for each in figures if each["day"] == "clear"]
    assert rows["clear"].endswith(f"0 of {sum(clear)} |")


def test_the_bounds_on_wrong_fixes_are_those_of_the_records() -> None:
    """``docs/accuracy.md``: none wrong of N, and 3/N."""
    page = (_ROOT / "docs" / "accuracy.md").read_text(encoding="utf-8")
    figures = _told(_ROOT / "docs" / "records" / "worlds.json")["figures"]
    drives = _told(_ROOT / "docs" / "records" / "closed-loop.json")["drives"]
    own = [each for each in figures if each["day"] not in ("impostor", "lookalike")]
    for counted, wrong in (
        (sum(each["pieces"] for each in own), sum(each["wrong"] for each in own)),
        (sum(each["pieces"] for each in own if each["day"] == "clear"), 0),
        (sum(each["pieces"] for each in figures if each["day"] == "impostor"), 0),
        (int(sum(each["way_m"] for each in drives) / 4.0), sum(each["wrong_fixes"] for each in drives)),
        (int(sum(each["way_m"] for each in drives if each["name"] == "clear") / 4.0), 0),
    ):
        (bound,) = set(re.findall(rf"\| {wrong} \| {counted:,} \| ([\d.]+) % \|", page))
        assert float(bound) == pytest.approx(300.0 / counted, rel=0.03)
    assert not any(each["ok"] for each in figures if each["day"] == "impostor")


def test_the_filter_of_the_page_moves_as_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    (text,) = python_of(_ROOT / "docs/navigation.md")
    exec(text, {})
    first, last = (re.findall(r"-?[\d.]+(?= m)", line) for line in capsys.readouterr().out.splitlines())
    assert float(first[0]) == pytest.approx(0.30 - 0.29, abs=0.006)
    assert (first[1], last[1]) == ("0.27", "0.00")


def test_the_skid_steer_page_runs(capsys: pytest.CaptureFixture[str]) -> None:
    step, field = python_of(_ROOT / "docs/skid_steer.md")
    exec(step, {})
    assert capsys.readouterr().out.endswith("False\n")
    # Some seconds of the field instead of nine minutes.
    assert "moments=26_000" in field
    scope: dict[str, Any] = {}
    exec(field.replace("moments=26_000", "moments=150"), scope)
    assert np.isfinite(np.asarray(scope["kept"].x_m)).all()


def test_the_site_of_the_page_is_one(tmp_path: Path) -> None:
    (text,) = re.findall(r"^```toml\n(.*?)^```", (_ROOT / "docs" / "scene.md").read_text(encoding="utf-8"), re.M | re.S)
    (tmp_path / "road.toml").write_text(text, encoding="utf-8")
    assert [drive.name for drive in read_site(tmp_path / "road.toml").drives] == ["first", "again"]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that blocks are run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def _follow(page: Path) -> None:
    for block in marked_blocks(page):
        follow(*block)


@pytest.mark.usefixtures("here")
def test_bring_your_own_radar() -> None:
    _follow(HOW_TO[0])
    with DriveLog.open("first.drive.h5") as log:
        assert (log.scans, log.channels, log.samples) == (500, 11, 256)
    assert Path("first.png").stat().st_size > 10_000


@pytest.mark.usefixtures("here")
def test_bring_your_own_vehicle() -> None:
    write_csv(Path("LOG.csv"), columns())
    _follow(HOW_TO[1])
    assert Path("log.drive.h5").is_file()


@pytest.mark.usefixtures("here")
def test_from_ros2() -> None:
    write_curved(Path("x.drive.h5"), "int16", scans=120)
    export_mcap("x.drive.h5", "RECORDING.mcap")
    Path("result").mkdir()
    curved_fixes(Path("result"), "drive", scans=120)
    _follow(HOW_TO[2])
    assert Path("out.mcap").stat().st_size > 10_000
    with AnyReader([Path("out.bag")]) as one, AnyReader([Path("out.db3")]) as two:
        assert one.message_count == two.message_count > 300
    # Times, places and quaternions, as evo reads them; a pose a scan, and a pose a fix.
    assert np.loadtxt("gnss.tum").shape == (120, 8)
    assert np.loadtxt("fixes.tum").shape == (40, 8)
    # By the library that QGIS reads with.
    fixes = pyogrio.raw.read("fixes.geojson")
    assert {"code", "correlation", "sigma_cross_m"} <= set(fixes[0]["fields"])
    assert len(fixes[2]) == 41


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site as ``make docs`` builds it, where no host can be reached."""
    if not all(map(find_spec, ("material", "mkdocstrings", "nbconvert"))):
        pytest.skip("lgprjax[docs] is not installed: the site was NOT built")
    folder = tmp_path_factory.mktemp("site")
    nowhere = dict.fromkeys(("http_proxy", "https_proxy", "HTTP_PROXY", "HTTPS_PROXY"), "http://127.0.0.1:9")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", folder],
        cwd=_ROOT,
        env=os.environ | nowhere | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return folder


class _Loaded(HTMLParser):
    """What a page has a browser fetch: not its links, which a reader follows, or not."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.classes: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.classes |= set(values.get("class", "").split())
        self.addresses += [values[name] for name in ("src", "srcset", "data", "poster") if name in values]
        if tag == "link" and values.get("rel") not in ("canonical", "prev", "next"):
            self.addresses.append(values["href"])


def test_no_page_of_the_site_loads_from_another_host(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 50
    for page in pages:
        loaded = _Loaded()
        loaded.feed(page.read_text(encoding="utf-8"))
        assert [each for each in loaded.addresses if re.match(r"\w+:(?!image/)|//", each)] == [], page
        # The theme fetches the script that draws these.
        assert "mermaid" not in loaded.classes, page
    for style in site.rglob("*.css"):
        assert re.findall(r"(?:@import|url\()\s*[\"']?(?:\w+:)?//", style.read_text(encoding="utf-8")) == [], style


def test_records_are_pages_that_performance_leads_to(site: Path) -> None:
    performance = (site / "performance.html").read_text(encoding="utf-8")
    for path in (_ROOT / "docs" / "records").glob("*.json"):
        assert f'href="records/{path.stem}.html"' in performance
        page = (site / "records" / f"{path.stem}.html").read_text(encoding="utf-8")
        assert f'href="{path.name}"' in page
        assert (site / "records" / path.name).is_file()
    worlds = (site / "records" / "worlds.html").read_text(encoding="utf-8")
    days, _ = markdown_of(read_figures(_ROOT / "docs" / "records" / "worlds.json")).split("\n\n")
    for line in days.splitlines()[2:]:
        assert all(f">{cell}</td>" in worlds for cell in line.strip("| ").split(" | ") if cell)


def test_notebooks_are_pages_with_their_pictures(site: Path) -> None:
    books = sorted(path.stem for path in (_ROOT / "notebooks").glob("*.ipynb"))
    contents = (site / "notebooks" / "index.html").read_text(encoding="utf-8")
    for name in books:
        assert f'href="{name}.html"' in contents
        page = (site / "notebooks" / f"{name}.html").read_text(encoding="utf-8")
        pictures = re.findall(rf'<img [^>]*src="({name}_files/[^"]+)"', page)
        assert pictures
        for path in (*pictures, *re.findall(r'<iframe [^>]*src="([^"]+)"', page), f"{name}.ipynb", f"{name}.py"):
            assert (site / "notebooks" / path).is_file(), path


def test_the_site_is_searched_when_it_is_opened_as_files(site: Path) -> None:
    with open_tab() as tab:
        tab.open((site / "notebooks" / "accuracy.html").as_uri(), 390, 844)
        tab.wait_for("document.readyState === 'complete'")
        tab.evaluate("document.querySelector('label[for=__search]').click()")
        tab.evaluate("document.querySelector('.md-search__input').focus()")
        tab.call("Input.insertText", text="potentiometer")
        tab.wait_for("document.querySelector('.md-search-result__link')", 60.0)
        found = tab.evaluate("[...document.querySelectorAll('.md-search-result__link')].map(each => each.href)")
        assert any("/own_vehicle.html" in each for each in found)
        assert all(each.startswith(site.as_uri()) for each in found)
        tab.open((site / "modes.html").as_uri(), 390, 844)
        tab.wait_for("document.readyState === 'complete' && location.pathname.endsWith('modes.html')")
        assert [each for each in tab.requested if not each.startswith("file:")] == []
        assert tab.complaints == []
