"""The page in headless Chromium for the tests: states to show, a browser, and what a test does with it.

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
import pytest

from runtime.display.browser import Tab, open_tab
from runtime.display.served_page import DRIVING, READY, ServedPage, serve

SIZES = [(1024, 600), (1280, 800), (800, 1280), (390, 844)]
LONG = "../routes/north_meadow_with_the_long_hedge_and_the_two_gates_beyond_the_quarry_2026.route.toml"
PATH = [[60.0 + 0.6 * i, 10.0 + 12.0 * math.sin((0.6 * i - 40.0) / 25.0)] for i in range(200)]
YAW_RAD = math.atan(12.0 / 25.0)
PLACE: dict[str, Any] = {"path": PATH, "pose": [100.0, 10.0, YAW_RAD], "gnss_pose": [101.2, 11.1, YAW_RAD]}
REFUSED = READY | PLACE | {"refusal": "OFF_ROUTE", "refusal_text": "the vehicle is 14 m beside the route"}
_LOOP = [[100.0 + 25.0 * math.cos(0.1 * i), 30.0 + 20.0 * math.sin(0.1 * i)] for i in range(-10, 25)]
TWICE = READY | PLACE | {
    "refusal": "AMBIGUOUS",
    "refusal_text": "the route passes here more than once",
    "places": [
        {"place": "66.2 m along", "to_go_m": 345.8, "ahead": PATH[66:110]},
        {"place": "231.0 m along", "to_go_m": 181.0, "ahead": _LOOP},
    ],
    "taken": None,
}  # fmt: skip
ALONE = READY | PLACE | {"lgpr": False, "bounded_by": ["GNSS"], "sigma_cross_m": 0.021, "places": []}
ERROR = DRIVING | PLACE | {
    "mode": "ERROR",
    "faults": ["DRIVE_BY_WIRE"],
    "cause": "the drive-by-wire box or its connection failed: drive-by-wire box is silent",
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
    """A display."""
    with serve(tmp_path_factory.mktemp("display")) as page:
        yield page


@pytest.fixture(scope="module")
def tab(served: ServedPage) -> Iterator[Tab]:
    """A browser; in the end nothing but the display was asked for anything."""
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


def everything_is_shown(tab: Tab, size: tuple[int, int]) -> None:
    """The page is as large as the window, nothing is outside of it, and no large number is cut."""
    page = tab.evaluate("[document.documentElement.scrollWidth, document.documentElement.scrollHeight]")
    assert page == list(size)
    outside = """[...document.querySelectorAll('header *, main *, footer')].filter((e) => {
        const box = e.getBoundingClientRect();
        return e.textContent && (box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight);
    }).map((e) => e.id || e.textContent)"""
    assert tab.evaluate(outside) == []
    cut = "['mode', 'speed', 'correlation', 'cross'].filter((n) => { const e = document.getElementById(n);"
    shown = " return e.scrollWidth > e.clientWidth + 1 && getComputedStyle(e).display != 'inline'})"
    assert tab.evaluate(cut + shown) == []


def check_plan(served: ServedPage, tab: Tab, size: tuple[int, int]) -> None:
    """Before engaging all of the plan is on the canvas, and what is written beside each other can be read."""
    served.show_worked(PLANNED)
    show(served, tab, BEFORE, size)
    tab.wait_for("['20', '1234', '1.5'].every((number) => document.body.innerText.includes(number))")
    tab.evaluate(LISTEN)
    tab.wait_for("window.drawn.length > 40")
    drawn = {text: (x, y) for text, x, y in tab.evaluate("window.drawn")}
    assert {"1", "20", "keep out 1", "keep out 2", "visit"} <= set(drawn)
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

# A field without a plan, driven by remote control: what is worked, and the tool with the part of it that is claimed.
OPEN_FIELD = FIELD | {
    "mode": "READY",
    "route": None,
    "set_speed_mps": None,
    "cross_track_m": None,
    "to_go_m": None,
    "pose": [8.8, 2.1, -0.01],
    "gnss_pose": [8.8, 2.1, 0.0],
    "path": [[0.4 * step, 0.1] for step in range(26)] + [[10.4 - 0.4 * step, 1.1] for step in range(26)],
    "refusal": "NO_PATH",
    "refusal_text": "no plan: the ground is recorded while you drive",
    "field": FIELD["field"] | {
        "perimeter": [], "fence": [], "line": None, "lines": 0, "told_on": False, "gnss": "fixed", "gnss_age_s": 0.4
    },
}  # fmt: skip
OPEN_WORKED: dict[str, Any] = {
    "east_m": 0.0,
    "north_m": -0.5,
    "block_m": 0.1,
    "runs": [[row, 12, 80] for row in range(10)] + [[row, 2, 80] for row in range(10, 20)],
    "level": 0.95,
    "levels": [0.9, 0.95, 0.99, 0.996],
    "worked_m2": 15.08,
    "full": False,
    "plan": None,
}
_ROUND = [2.0 * math.pi * step / 48 for step in range(48)]
OPEN_SHAPE: dict[str, Any] = {
    "shape": [
        [1.2 + 0.06 * math.copysign(abs(x) ** 0.3, x), 0.505 * math.copysign(abs(y) ** 0.3, y)]
        for x, y in ((math.cos(angle), math.sin(angle)) for angle in _ROUND)
    ],
    "tool": [1.2, 0.0, 0.15, 0.6],
    "pass_m": [-0.509, 0.509],
    "level": 0.95,
    "sigma_m": 0.0548,
}  # fmt: skip

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
LISTEN = """(() => { window.drawn = []; const pen = CanvasRenderingContext2D.prototype, write = pen.fillText;
    pen.fillText = function (text, x, y) { window.drawn.push([text, x, y]); write.call(this, text, x, y); }; })()"""
