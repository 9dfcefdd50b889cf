"""The page in headless Chromium: what an operator reads, that nothing is fetched from elsewhere, and how it looks.

With ``LGPRJAX_PICTURES`` set to a folder the pictures of the documentation are written there.
"""

import io
import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import matplotlib.image
import numpy as np
import pytest

from runtime.display.browser import Tab, open_tab
from runtime.display.served_page import DRIVING, READY, ServedPage, serve

SIZES = [(1024, 600), (1280, 800), (800, 1280), (390, 844)]
LONG = "../routes/north_meadow_with_the_long_hedge_and_the_two_gates_beyond_the_quarry_2026.route.toml"
PATH = [[60.0 + 0.6 * i, 10.0 + 12.0 * math.sin((0.6 * i - 40.0) / 25.0)] for i in range(200)]
YAW_RAD = math.atan(12.0 / 25.0)
PLACE: dict[str, Any] = {"path": PATH, "pose": [100.0, 10.0, YAW_RAD], "gnss_pose": [101.2, 11.1, YAW_RAD]}
REFUSED = READY | PLACE | {"refusal": "OFF_ROUTE", "refusal_text": "the vehicle is 14 m beside the route"}
ERROR = DRIVING | PLACE | {
    "mode": "ERROR",
    "faults": ["DRIVE_BY_WIRE"],
    "cause": "the drive-by-wire box or its line failed: drive-by-wire box is silent",
    "warnings": ["steering potentiometer and encoder disagree by 4.1 degrees", "storage is nearly full"],
    "reaction": "STOP",
    "reasons": ["steering sensors disagree"],
    "correlation": 0.41,
    "code": "low_correlation",
    "ok_share": 0.12,
    "cross_track_m": -0.62,
    "processes": DRIVING["processes"] | {"registration": "relaunched"},
}  # fmt: skip

_BROKEN = {"name": "/data/routes/old road.route.toml", "length_m": 88.0}
NAMED = READY | PLACE | {
    "route": LONG,
    "routes": [
        {"name": LONG, "length_m": 412.0, "problem": None},
        _BROKEN | {"problem": f"{_BROKEN['name']}: map: expected the map of the run, found /data/other.map.h5"},
    ],
    "refusal": "HEALTH",
    "refusal_text": "navigation is not good enough: position uncertain by more than 0.25 m across",
    "reaction": "STOP",
    "reasons": ["position uncertain by more than 0.25 m across"],
    "speed_mps": -0.04,
    "monitor": {"free_mb": 48200.0, "memory_mb": 22616.0, "rss_mb": {"control": 812.5, "registration": 1398.0}},
}  # fmt: skip


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServedPage]:
    with serve(tmp_path_factory.mktemp("display")) as page:
        yield page


@pytest.fixture(scope="module")
def tab(served: ServedPage) -> Iterator[Tab]:
    with open_tab() as opened:
        yield opened
    elsewhere = [url for url in opened.requested if urlsplit(url).netloc != served.host]
    assert elsewhere == []
    assert f"ws://{served.host}/socket" in opened.requested


def show(served: ServedPage, tab: Tab, state: dict[str, Any], size: tuple[int, int] = SIZES[0], **how: bool) -> None:
    """A page freshly opened on a state."""
    served.show(state)
    tab.open(served.url, *size, **how)
    tab.wait_for("!document.body.classList.contains('stale')")
    assert tab.complaints == []


def picture(tab: Tab, name: str | None = None) -> Any:
    """The window's colours, and the file of the documentation where one is wanted."""
    png = tab.picture()
    folder = os.environ.get("LGPRJAX_PICTURES")
    path = Path(folder or "/nonexistent") / f"display-{name}.png"
    if folder and name:
        path.write_bytes(png)
    return matplotlib.image.imread(io.BytesIO(png), format="png")[..., :3]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("state", [DRIVING | PLACE, ERROR, REFUSED, NAMED], ids=["driving", "error", "refused", "long"])
def test_everything_is_on_the_screen(
    served: ServedPage, tab: Tab, state: dict[str, Any], size: tuple[int, int]
) -> None:
    show(served, tab, state, size)
    page = tab.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert page == list(size)
    outside = """[...document.querySelectorAll('header *, main *, footer')].filter((e) => {
        const box = e.getBoundingClientRect();
        return e.textContent && (box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight);
    }).map((e) => e.id || e.textContent)"""
    assert tab.evaluate(outside) == []
    cut = "['mode', 'speed', 'correlation', 'cross'].filter((n) => { const e = document.getElementById(n);"
    assert (
        tab.evaluate(cut + " return e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display != 'inline'})")
        == []
    )


@pytest.mark.parametrize("size", [(360, 740), (768, 1024), (1280, 800), (1920, 1080)])
@pytest.mark.parametrize("dark", [False, True], ids=["day", "night"])
def test_at_twice_the_zoom_the_text_grows_and_everything_can_be_scrolled_to(
    served: ServedPage, tab: Tab, size: tuple[int, int], dark: bool
) -> None:
    """A browser that zooms by 2 shows half as many of its pixels, each twice as large."""
    read = "parseFloat(getComputedStyle(document.getElementById('words')).fontSize)"
    show(served, tab, ERROR, size, dark=dark)
    before = tab.evaluate(read)
    show(served, tab, ERROR, (size[0] // 2, size[1] // 2), dark=dark)
    assert 2.0 * tab.evaluate(read) > 1.25 * before
    # Nothing is cut at the side, and no text covers the next: the page below the mode scrolls.
    assert tab.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert tab.evaluate("getComputedStyle(document.documentElement).overflowY") == "visible"
    apart = """(() => { const tops = ['top', 'figures', 'cross-tile', 'words', 'plan-box', 'routes', 'foot'];
        const boxes = tops.map((name) => document.getElementById(name).getBoundingClientRect());
        return boxes.every((box, at) => at === 0 || box.top >= boxes[at - 1].bottom - 0.5); })()"""
    assert tab.evaluate(apart)
    cut = """[...document.querySelectorAll('header *, main *, footer *')].filter((e) => e.children.length === 0
        && e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display !== 'inline').map((e) => e.id)"""
    assert tab.evaluate(cut) == []


@pytest.mark.parametrize("mode", ["READY", "SPEED", "ERROR", "EMERGENCY_STOP", "UNKNOWN"])
def test_on_a_phone_at_twice_the_zoom_the_mode_stays_and_leaves_room(served: ServedPage, tab: Tab, mode: str) -> None:
    show(served, tab, DRIVING | PLACE | {"mode": mode}, (180, 370))
    heights = "['top', 'theme', 'up'].map((name) => document.getElementById(name).getBoundingClientRect().height)"
    header, *buttons = tab.evaluate(heights)
    assert header <= 0.3 * 370
    assert min(buttons) >= 24.0  # pixels of a page that is shown twice as large
    cut = "['mode', 'mode-text', 'theme', 'up'].filter((name) => { const e = document.getElementById(name);"
    assert tab.evaluate(cut + " return e.scrollWidth > e.clientWidth + 1})") == []
    # Scrolled to the end, the mode is still at the top.
    tab.evaluate("window.scrollTo(0, document.documentElement.scrollHeight)")
    assert tab.evaluate("document.getElementById('mode').getBoundingClientRect().top") >= 0.0


def test_every_button_is_reached_by_the_keyboard_and_shows_it(served: ServedPage, tab: Tab) -> None:
    show(served, tab, READY | PLACE, (1280, 800))
    reached = []
    for _ in range(4):
        for kind in ("keyDown", "keyUp"):
            tab.call("Input.dispatchKeyEvent", type=kind, key="Tab", code="Tab", windowsVirtualKeyCode=9)
        assert tab.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"
        reached.append(tab.evaluate("document.activeElement.id || document.activeElement.textContent"))
    assert reached == ["theme", "up", "●\u00a0meadow412 m", "○\u00a0quarry1609 m"]


def test_driving(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE)
    assert tab.text("#mode") == "STEERING + SPEED"
    assert tab.text("#speed") == "4.4"
    assert tab.text("#speed-more") == "set 4.50"
    assert tab.text("#cross") == "0.07 m left"
    assert tab.text("#correlation") == "0.93"
    assert tab.text("#correlation-more") == "good"
    assert tab.text("#share") == "98 % good in 10 s"
    assert tab.text("#words") == "✓ No warnings"
    assert tab.text("#to-go") == "287 m to go"
    # Left of the path stands left of the middle.
    mark = "document.getElementById('bar-mark').getBoundingClientRect().right"
    bar = "document.getElementById('bar').getBoundingClientRect()"
    assert tab.evaluate(f"{mark} < ({bar}.left + {bar}.right) / 2")
    # The route stands there, and cannot be changed.
    assert "meadow" in tab.text("#routes")
    assert "quarry" not in tab.text("#routes")
    assert tab.evaluate("[...document.querySelectorAll('#routes button')].every((button) => button.disabled)")
    picture(tab, "day")


def test_nothing_on_the_page_engages(served: ServedPage, tab: Tab) -> None:
    show(served, tab, READY | PLACE)
    buttons = tab.evaluate("[...document.querySelectorAll('button, input, a, form')].map((e) => e.id || e.textContent)")
    assert buttons == ["theme", "up", "●\u00a0meadow412 m", "○\u00a0quarry1609 m", "○\u00a0old roadtoo tight a curve"]


def test_choosing_a_route(served: ServedPage, tab: Tab) -> None:
    show(served, tab, READY | PLACE)
    served.requests()
    tab.evaluate("document.querySelectorAll('#route-list button')[2].click()")
    tab.evaluate("document.querySelectorAll('#route-list button')[1].click()")
    tab.wait_for("document.getElementById('answer').textContent === ''")
    served.show(READY | PLACE | {"route": "quarry", "path": None})
    tab.wait_for("document.querySelector('[aria-pressed=true]').textContent.includes('quarry')")
    assert served.requests() == [{"select_route": "quarry"}]


def test_a_refused_engage_says_why(served: ServedPage, tab: Tab) -> None:
    show(served, tab, REFUSED)
    assert tab.text("#mode") == "READY"
    assert "cannot be engaged" in tab.text("#mode-text")
    assert tab.text("#words") == "▲ Cannot engage: the vehicle is 14 m beside the route"


def test_an_error_in_words(served: ServedPage, tab: Tab) -> None:
    show(served, tab, ERROR)
    assert tab.text("#mode") == "ERROR"
    words = tab.text("#words").split("\n")
    # Nobody stops who is not driven: what navigation finds is a warning then.
    assert words[0] == "Because: the drive-by-wire box or its line failed: drive-by-wire box is silent"
    assert "▲ steering sensors disagree" in words
    assert not any("Stopping" in word for word in words)
    assert "▲ steering potentiometer and encoder disagree by 4.1 degrees" in words
    assert tab.text("#correlation-more") == "could be chance"
    assert tab.text("#cross") == "0.62 m right"
    picture(tab, "error")


def test_what_is_shown_agrees_with_the_mode_and_names_files_not_folders(served: ServedPage, tab: Tab) -> None:
    show(served, tab, NAMED)
    words = tab.text("#words").split("\n")
    assert words == ["▲ Cannot engage: navigation is not good enough: position uncertain by more than 0.25 m across"]
    assert tab.text("#speed") == "0.0"
    everything = tab.text("body")
    assert "/data/" not in everything
    assert "../" not in everything
    assert "north_meadow_with_the_long_hedge_and_the_two_gates_beyond_the_quarry_2026" in everything
    assert "expected the map of the run, found other.map.h5" in everything
    assert "this run holds 2.2 GB" in tab.text("#foot")


def test_a_slow_drive_says_why_once(served: ServedPage, tab: Tab) -> None:
    scans = "no scans: radar, its line or registration"
    state = DRIVING | PLACE | {"slow": [scans], "warnings": [scans], "reasons": ["GNSS is silent"], "cap_mps": 2.0}
    show(served, tab, state)
    assert tab.text("#words").split("\n") == [f"▲ Slowed: {scans}", "▲ GNSS is silent"]
    assert "limit 2.0" in tab.text("#speed-more")


def test_names_are_text(served: ServedPage, tab: Tab) -> None:
    markup = "<img src=x onerror=document.title='hurt'><b>"
    state = READY | {"warnings": [markup], "routes": [{"name": markup, "length_m": None, "problem": markup}]}
    show(served, tab, state)
    tab.wait_for("document.querySelector('#route-list button')")
    assert markup in tab.text("#words")
    assert tab.evaluate("document.querySelectorAll('img, main b').length") == 0
    assert tab.evaluate("document.title") == "Vehicle"


def test_a_state_of_nothing_but_nulls_is_shown(served: ServedPage, tab: Tab) -> None:
    show(served, tab, dict.fromkeys(DRIVING))
    assert tab.text("#mode") == "MODE UNKNOWN"
    assert tab.text("#speed") == tab.text("#correlation") == tab.text("#cross") == "–"


def test_many_warnings_are_counted(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | {"warnings": [f"warning {i}" for i in range(30)]})
    words = tab.text("#words").split("\n")
    assert words[0] == "▲ warning 0"
    assert words[-1] == f"▲ and {30 - (len(words) - 1)} more"
    assert len(words) > 3


def test_old_data_is_said_loudly(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE)
    served.state = None
    tab.wait_for("document.body.classList.contains('stale')", 5.0)
    assert tab.text("#mode") == "NO DATA"
    tab.wait_for("document.querySelector('#no-data').innerText.includes('The control process is silent for ')", 5.0)
    assert tab.text("#no-data").startswith("NO DATA")
    shares = picture(tab).reshape(-1, 3)
    red = (shares[:, 0] > 0.5) & (shares[:, 1] < 0.2) & (shares[:, 2] < 0.2)
    assert red.mean() > 0.15
    served.show(DRIVING | PLACE)
    tab.wait_for("!document.body.classList.contains('stale')")
    assert tab.text("#mode") == "STEERING + SPEED"


def test_night_dazzles_nobody(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE, dark=True)
    night = picture(tab, "night")
    assert night.mean() < 0.15
    # No white, and no more blue than red or green anywhere.
    assert night.min(axis=2).max() < 0.65
    assert np.all(night[..., 2] <= night[..., :2].max(axis=2) + 0.02)
    tab.evaluate("document.getElementById('theme').click()")
    assert picture(tab).mean() > 0.6
    tab.evaluate("document.getElementById('theme').click()")
    assert picture(tab).mean() < 0.15


def test_the_plan_turns(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE)

    def path_pixels() -> Any:
        box = tab.evaluate(
            "(b => [b.left, b.top, b.right, b.bottom])(document.getElementById('plan').getBoundingClientRect())"
        )
        left, top, right, bottom = (round(edge) for edge in box)
        plan = picture(tab)[top : bottom - 30, left:right]
        return np.argwhere((plan[..., 2] > 0.6) & (plan[..., 0] < 0.1)) - (np.array(plan.shape[:2]) / 2)

    # North is up: a path to the east-north-east lies flatter than it is high. Turned, it stands upright.
    north = np.std(path_pixels(), axis=0)
    assert north[0] < 0.7 * north[1]
    tab.evaluate("document.getElementById('up').click()")
    turned = np.std(path_pixels(), axis=0)
    assert turned[0] > 2.0 * turned[1]
    assert tab.text("#up") == "NORTH UP"


def test_without_the_computer(tab: Tab, served: ServedPage, tmp_path: Path) -> None:
    with serve(tmp_path) as other:
        other.show(DRIVING)
        tab.open(other.url, *SIZES[0])
        tab.wait_for("!document.body.classList.contains('stale')")
        other.process.kill()
        tab.wait_for("document.body.classList.contains('stale')", 5.0)
        assert "No connection to the vehicle" in tab.text("#no-data")
    tab.requested[:] = [url for url in tab.requested if urlsplit(url).netloc != other.host]
    show_again = tab.complaints.copy()
    tab.complaints.clear()
    assert all("WebSocket" in complaint for complaint in show_again)
    show(served, tab, DRIVING)


CORNERS = [[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]]
LINES = [[x, y] for line in range(6) for x, y in ((0.0, 0.6 + line), (30.0, 0.6 + line))[:: -1 if line % 2 else 1]]
FIELD = DRIVING | {
    "route": "north field",
    "routes": [],
    "speed_mps": 0.42,
    "set_speed_mps": 0.6,
    "cross_track_m": -0.012,
    "pose": [14.0, 3.6, math.pi],
    "gnss_pose": [14.0, 3.6, 0.0],
    "path": LINES,
    "processes": dict.fromkeys(("control", "coverage", "recorder", "display", "monitor"), "ready"),
    "field": {
        "perimeter": CORNERS,
        "line": 4,
        "lines": 21,
        "tool_width_m": 1.2,
        "tool_ahead_m": 1.2,
        "told_on": True,
        "turns": True,
        "depth_m": 0.148,
        "depth_right": True,
        "depth_asked_m": 0.15,
        "gnss": "none",
        "gnss_age_s": 12.4,
        "heading_known": True,
        "sigma_heading_deg": 0.21,
    },
}
WORKED = {
    "east_m": 0.0,
    "north_m": 0.0,
    "block_m": 0.2,
    "runs": [[row, 0, 150] for row in range(15)],
    "level": 0.95,
    "worked_m2": 90.0,
    "field_m2": 600.0,
}


def test_a_field_shows_its_line_tool_gnss_and_what_is_worked(served: ServedPage, tab: Tab) -> None:
    served.show_worked(WORKED)
    show(served, tab, FIELD)
    tab.wait_for("document.body.innerText.includes('Worked at 95 %: 15 %')")
    told = tab.evaluate("document.body.innerText")
    assert told.count("GNSS off for") == 1
    for words in (
        "worked",
        "line 4 of 21",
        "15 cm",
        "told on, 15 cm",
        "GNSS off for 12 s",
        "Field north field",
        "drives its plan",
    ):
        assert words in told, words
    day = picture(tab, "field")
    bare = FIELD | {"field": FIELD["field"] | {"turns": False, "told_on": True}}
    show(served, tab, bare)
    assert "OFF" in tab.evaluate("document.body.innerText")
    # Worked ground has its colour: some percent of the window.
    colour = np.array([0x9A, 0xD0, 0xB0]) / 255.0
    assert 0.001 < float((np.abs(day - colour).max(axis=-1) < 0.02).mean()) < 0.5


PLAN: dict[str, object] = {
    "swaths": [[30.0 * (line % 2), 0.6 + line, 30.0 * (1 - line % 2), 0.6 + line] for line in range(20)],
    "reverse": [[[30.0, 5.0], [20.0, 5.5], [12.0, 5.5]]],
    "keep_outs": [[[8.0, 12.0], [11.0, 12.0], [11.0, 15.0]], [[20.0, 12.0], [22.0, 12.0], [22.0, 14.0]]],
    "computed_corner": [0.0, 20.0],
    "length_m": 1234.4,
    "time_s": 5461,
}
PLANNED = WORKED | {"runs": [], "worked_m2": 0.0, "plan": PLAN}
BEFORE = FIELD | {"mode": "READY", "refusal": "NONE", "warnings": [], "reasons": [], "pose": [-5.0, 0.6, 0.0]}
BEFORE["field"] = FIELD["field"] | {"gnss": "fixed", "gnss_age_s": 0.3, "told_on": False, "fence": [
    [[-6.0, -6.0], [36.0, -6.0], [36.0, 26.0], [-6.0, 26.0]]
]}  # fmt: skip
_LISTEN = """(() => { window.drawn = []; const pen = CanvasRenderingContext2D.prototype, write = pen.fillText;
    pen.fillText = function (text, x, y) { window.drawn.push([text, x, y]); write.call(this, text, x, y); }; })()"""


@pytest.mark.parametrize("size", SIZES)
def test_before_engaging_the_plan_is_seen_as_it_will_be_driven(
    served: ServedPage, tab: Tab, size: tuple[int, int]
) -> None:
    served.show_worked(PLANNED)
    show(served, tab, BEFORE, size)
    tab.wait_for("document.body.innerText.includes('Plan: 20 swaths, 1234 m, 1.5 h')")
    assert tab.text("#words") == "▲ One corner of the field is computed: visit it first"
    assert "in reverse" in tab.text("#legend")
    assert "computed corner" in tab.text("#legend")
    tab.evaluate(_LISTEN)
    tab.wait_for("window.drawn.length > 40")
    drawn = {text: (x, y) for text, x, y in tab.evaluate("window.drawn")}
    assert {"1", "20", "keep out 1", "keep out 2", "visit"} <= set(drawn)
    # All of the field is on the canvas, and what is written beside each other can be read.
    width, height = tab.evaluate("(c => [c.clientWidth, c.clientHeight])(document.getElementById('plan'))")
    away = {text: at for text, at in drawn.items() if not (0.0 < at[0] < width and 0.0 < at[1] < height)}
    assert away == {}, (width, height)
    numbers = [place for text, place in drawn.items() if text.isdigit()]
    assert 3 <= len(numbers) <= 13
    assert min(math.dist(a, b) for a in numbers for b in numbers if a != b) >= 22.0
    page = tab.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert page == list(size)
    heading = tab.evaluate(
        "['mode-text', 'top'].map((name) => document.getElementById(name).getBoundingClientRect().bottom)"
    )
    assert heading[0] < heading[1]


def test_dashes_are_ways_in_reverse_and_nothing_is_numbered_while_it_drives(served: ServedPage, tab: Tab) -> None:
    served.show_worked(PLANNED)
    show(served, tab, BEFORE, SIZES[1])
    tab.wait_for("document.body.innerText.includes('Plan: 20 swaths')")

    def orange() -> float:
        pixels = picture(tab, "plan")
        return float((np.abs(pixels - np.array([0xD3, 0x54, 0x00]) / 255.0).max(axis=-1) < 0.02).sum())

    both = orange()
    served.show_worked(PLANNED | {"plan": PLAN | {"reverse": []}})
    tab.wait_for("document.getElementById('reverse-key').hidden")
    assert both > orange() + 100
    served.show_worked(PLANNED)
    served.show(FIELD)
    tab.wait_for("document.getElementById('mode').innerText.includes('SPEED')")
    tab.evaluate(_LISTEN)
    tab.wait_for("window.drawn.length > 12")
    told = {text for text, _, _ in tab.evaluate("window.drawn")}
    assert "keep out 1" in told
    assert not told & {"1", "20", "visit"}
    assert "computed" not in tab.text("body")
    # A message of which half is missing is no plan.
    served.show_worked(PLANNED | {"plan": {"swaths": []}})
    served.show(BEFORE)
    tab.wait_for("!document.body.innerText.includes('Plan:')")
    assert tab.complaints == []
