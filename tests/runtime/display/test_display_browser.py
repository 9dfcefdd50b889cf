"""The page in headless Chromium: what an operator reads, that a lost page says so, and that nothing on it engages.

All sizes, zooms, the night and the plan's picture: ``validation/loops/test_display_page.py``.
"""

from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

from runtime.display.browser import Tab
from runtime.display.served_page import BROKEN, DRIVING, READY, ServedPage, serve
from validation.loops.browsed_page import (
    ALONE,
    ERROR,
    FIELD,
    OPEN_FIELD,
    OPEN_SHAPE,
    OPEN_WORKED,
    PLACE,
    SIZES,
    TWICE,
    WORKED,
    check_plan,
    everything_is_shown,
    picture,
    served,
    show,
    tab,
)

__all__ = ["served", "tab"]


def test_driving(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE)
    everything_is_shown(tab, SIZES[0])
    assert tab.text("#speed") == "4.4"
    assert tab.text("#correlation") == "0.93"
    for place, number in (("#speed-more", "4.50"), ("#cross", "0.07"), ("#share", "98 %"), ("#to-go", "287 m")):
        assert number in tab.text(place)
    # Left of the path stands left of the middle.
    mark = "document.getElementById('bar-mark').getBoundingClientRect().right"
    bar = "document.getElementById('bar').getBoundingClientRect()"
    assert tab.evaluate(f"{mark} < ({bar}.left + {bar}.right) / 2")
    # The route stands there, and cannot be changed.
    assert "meadow" in tab.text("#routes")
    assert "quarry" not in tab.text("#routes")
    assert tab.evaluate("[...document.querySelectorAll('#routes button')].every((button) => button.disabled)")
    picture(tab, "day")


def test_an_error_is_told_with_its_cause(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE)
    mode = tab.text("#mode")
    show(served, tab, ERROR)
    assert tab.text("#mode") != mode
    words = tab.text("#words")
    assert all(each in words for each in (ERROR["cause"], ERROR["reasons"][0], ERROR["warnings"][0]))
    assert "0.62" in tab.text("#cross")
    picture(tab, "error")
    show(served, tab, ERROR, (390, 844))
    everything_is_shown(tab, (390, 844))


def test_a_kit_that_only_steers_tells_the_limit_and_the_hand_over(served: ServedPage, tab: Tab) -> None:
    steering = DRIVING | PLACE | {"mode": "STEERING", "set_speed_mps": None, "lit": False, "limit_mps": 4.47}
    show(served, tab, steering)
    assert "4.5" in tab.text("#speed-more")
    assert "✓" in tab.text("#words")
    show(served, tab, steering | {"limit_mps": 2.0, "slow": ["GNSS is silent"], "refusal_text": "it only steers"})
    words = tab.text("#words")
    assert all(each in words for each in ("2.0", "released", "GNSS is silent", "it only steers"))
    usual = {"mode": "MANUAL", "cause": "more than 3 ft off the path"}
    show(served, tab, steering | usual)
    by_hand = tab.text("#mode")
    show(served, tab, steering | usual | {"lit": True})
    assert tab.text("#mode") not in (by_hand, "")
    assert usual["cause"] in tab.text("#words")
    everything_is_shown(tab, SIZES[0])


def test_a_route_is_chosen_and_nothing_else(served: ServedPage, tab: Tab) -> None:
    show(served, tab, READY | PLACE)
    buttons = tab.evaluate("[...document.querySelectorAll('button, input, a, form')].map((e) => e.id || e.textContent)")
    assert buttons[:2] == ["theme", "up"]
    for button, named in zip(buttons[2:], ("meadow", "quarry", BROKEN["problem"]), strict=True):
        assert named in button
    served.requests()
    tab.evaluate("document.querySelectorAll('#route-list button')[2].click()")
    tab.evaluate("document.querySelectorAll('#route-list button')[1].click()")
    tab.wait_for("document.getElementById('answer').textContent === ''")
    served.show(READY | PLACE | {"route": "quarry", "path": None})
    tab.wait_for("document.querySelector('[aria-pressed=true]').textContent.includes('quarry')")
    assert served.requests() == [{"select_route": "quarry"}]


def test_a_place_is_chosen_where_the_route_passes_twice(served: ServedPage, tab: Tab) -> None:
    show(served, tab, TWICE)
    everything_is_shown(tab, SIZES[0])
    assert "2 times" in tab.text("#route-title")
    assert all(each in tab.text("#route-list") for each in ("A: 66.2 m along", "B: 231.0 m along", "346 m", "181 m"))
    picture(tab, "places")
    served.requests()
    tab.evaluate("document.querySelectorAll('#route-list button')[1].click()")
    tab.wait_for("document.getElementById('answer').textContent === ''")
    served.show(TWICE | {"taken": "231.0 m along"})
    tab.wait_for("document.querySelector('#route-list [aria-pressed=true]').textContent.includes('B: 231.0')")
    assert served.requests() == [{"select_route": "meadow", "place": "231.0 m along"}]


def test_without_a_map_the_page_shows_how_well_gnss_knows_the_place(served: ServedPage, tab: Tab) -> None:
    show(served, tab, ALONE)
    everything_is_shown(tab, SIZES[0])
    assert (tab.text("#correlation-title"), tab.text("#correlation")) == ("Position", "2.1 cm")
    assert "GNSS/INS alone" in tab.text("#share")
    picture(tab, "gnss")


def test_names_are_text(served: ServedPage, tab: Tab) -> None:
    markup = "<img src=x onerror=document.title='hurt'><b>"
    state = READY | {"warnings": [markup], "routes": [{"name": markup, "length_m": None, "problem": markup}]}
    show(served, tab, state)
    tab.wait_for("document.querySelector('#route-list button')")
    assert markup in tab.text("#words")
    assert tab.evaluate("document.querySelectorAll('img, main b').length") == 0
    assert tab.evaluate("document.title") != "hurt"


def test_old_data_is_said_loudly(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | PLACE)
    mode = tab.text("#mode")
    served.state = None
    tab.wait_for("document.body.classList.contains('stale')", 5.0)
    assert tab.text("#mode") != mode
    tab.wait_for("/[0-9]/.test(document.querySelector('#no-data').innerText)", 5.0)
    shares = picture(tab).reshape(-1, 3)
    red = (shares[:, 0] > 0.5) & (shares[:, 1] < 0.2) & (shares[:, 2] < 0.2)
    assert red.mean() > 0.15
    served.show(DRIVING | PLACE)
    tab.wait_for("!document.body.classList.contains('stale')")
    assert tab.text("#mode") == mode


def test_without_the_computer(served: ServedPage, tab: Tab, tmp_path: Path) -> None:
    with serve(tmp_path) as other:
        other.show(DRIVING)
        tab.open(other.url, *SIZES[0])
        tab.wait_for("!document.body.classList.contains('stale')")
        other.process.kill()
        tab.wait_for("document.body.classList.contains('stale')", 5.0)
        assert tab.text("#no-data") != ""
    tab.requested[:] = [url for url in tab.requested if urlsplit(url).netloc != other.host]
    complaints = tab.complaints.copy()
    tab.complaints.clear()
    assert all("WebSocket" in complaint for complaint in complaints)
    show(served, tab, DRIVING)


def test_a_field_shows_its_line_tool_gnss_and_what_is_worked(served: ServedPage, tab: Tab) -> None:
    served.show_worked(WORKED)
    show(served, tab, FIELD)
    tab.wait_for("document.body.innerText.includes('15 %')")
    told = tab.evaluate("document.body.innerText")
    for number in ("95 %", "4 of 21", "15 cm", "12 s", "north field"):
        assert number in told, number
    # Worked ground has its colour: some percent of the window.
    colour = np.array([0x9A, 0xD0, 0xB0]) / 255.0
    assert 0.001 < float((np.abs(picture(tab, "field") - colour).max(axis=-1) < 0.02).mean()) < 0.5
    # A tool that was told to work, and stands still.
    assert "OFF" not in told.split()
    show(served, tab, FIELD | {"field": FIELD["field"] | {"turns": False}})
    assert "OFF" in tab.evaluate("document.body.innerText").split()


def test_without_a_plan_the_tool_is_seen_as_it_is_claimed_and_the_level_is_chosen(served: ServedPage, tab: Tab) -> None:
    served.show_worked(OPEN_WORKED)
    served.shape = OPEN_SHAPE
    served.requests()
    for size in (SIZES[0], (390, 844)):
        show(served, tab, OPEN_FIELD, size)
        tab.wait_for("document.querySelectorAll('#levels button').length === 4")
        everything_is_shown(tab, size)
        told = tab.evaluate("document.body.innerText")
        for number in ("95 %", "1.02", "1.20 m", "5.5 cm", "15.1 m²", "15 cm"):
            assert number in told, number
        assert "%" not in tab.text("#routes").replace("95 %", "")
    # In the picture of the tool the claimed part has its colour, and does not fill the outline.
    place = "document.getElementById('tool-shape').getBoundingClientRect()"
    box = tab.evaluate(f"(b => [b.left, b.top, b.width, b.height])({place})")
    left, top, width, height = (round(each) for each in box)
    seen = picture(tab, "tool-shape")[top : top + height, left : left + width]
    claimed = np.abs(seen - np.array([0x58, 0xB8, 0x80]) / 255.0).max(axis=-1) < 0.02
    assert 0.05 < claimed.mean() < 0.5
    tab.evaluate("document.querySelectorAll('#levels button')[3].click()")
    tab.wait_for("document.getElementById('answer').textContent === ''")
    served.shape = OPEN_SHAPE | {"shape": [], "level": 0.996, "pass_m": [-0.455, 0.455]}
    tab.wait_for("document.querySelector('#levels [aria-pressed=true]').textContent === '99.6'")
    assert "0.91" in tab.text("#claim")
    assert served.requests() == [{"select_level": 0.996}]
    # Without a heading nothing is claimed; a shape that comes no more is not shown as if it were now.
    served.show(OPEN_FIELD | {"field": OPEN_FIELD["field"] | {"heading_known": False}})
    tab.wait_for("!document.getElementById('claim').innerText.includes('0.91')")
    served.shape = None
    tab.wait_for("document.getElementById('claim').hidden", 5.0)


def test_before_engaging_the_plan_is_seen_as_it_will_be_driven(served: ServedPage, tab: Tab) -> None:
    check_plan(served, tab, SIZES[1])
