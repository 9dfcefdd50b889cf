"""The page in headless Chromium at every size and zoom, by night, with the plan's picture."""

from typing import Any

import numpy as np
import pytest

from runtime.display.browser import Tab
from runtime.display.served_page import DRIVING, READY, ServedPage
from validation.loops.browsed_page import (
    BEFORE,
    ERROR,
    FIELD,
    LISTEN,
    NAMED,
    OPEN_FIELD,
    OPEN_SHAPE,
    OPEN_WORKED,
    PLACE,
    PLAN,
    PLANNED,
    REFUSED,
    SIZES,
    check_plan,
    everything_is_shown,
    picture,
    served,
    show,
    tab,
)

__all__ = ["served", "tab"]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("state", [DRIVING | PLACE, ERROR, REFUSED, NAMED], ids=["driving", "error", "refused", "long"])
def test_everything_is_on_the_screen(
    served: ServedPage, tab: Tab, state: dict[str, Any], size: tuple[int, int]
) -> None:
    show(served, tab, state, size)
    everything_is_shown(tab, size)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("state", [FIELD, OPEN_FIELD], ids=["plan", "no plan"])
def test_the_tool_at_a_level_fits_beside_all_else(
    served: ServedPage, tab: Tab, state: dict[str, Any], size: tuple[int, int]
) -> None:
    served.show_worked(OPEN_WORKED)
    served.shape = OPEN_SHAPE
    show(served, tab, state, size)
    tab.wait_for("document.querySelectorAll('#levels button').length === 4")
    everything_is_shown(tab, size)
    served.shape = None


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
    assert reached[:2] == ["theme", "up"]
    assert [name in button for name, button in zip(("meadow", "quarry"), reached[2:], strict=True)] == [True, True]


def test_what_is_shown_names_files_not_folders(served: ServedPage, tab: Tab) -> None:
    show(served, tab, NAMED)
    assert NAMED["refusal_text"] in tab.text("#words")
    assert tab.text("#speed") == "0.0"
    everything = tab.text("body")
    assert "/data/" not in everything
    assert "../" not in everything
    assert "north_meadow_with_the_long_hedge_and_the_two_gates_beyond_the_quarry_2026" in everything
    assert "other.map.h5" in everything
    assert "2.2 GB" in tab.text("#foot")


def test_what_slows_a_drive_is_told_once(served: ServedPage, tab: Tab) -> None:
    scans = "no scans: radar, its connection or registration"
    state = DRIVING | PLACE | {"slow": [scans], "warnings": [scans], "reasons": ["GNSS is silent"], "cap_mps": 2.0}
    show(served, tab, state)
    assert tab.text("#words").count(scans) == 1
    assert tab.text("#words").count("GNSS is silent") == 1
    assert "2.0" in tab.text("#speed-more")


def test_a_state_of_nothing_but_nulls_is_shown(served: ServedPage, tab: Tab) -> None:
    show(served, tab, dict.fromkeys(DRIVING))
    assert tab.text("#mode") != ""
    assert tab.text("#speed") == tab.text("#correlation") == tab.text("#cross")


def test_many_warnings_are_counted(served: ServedPage, tab: Tab) -> None:
    show(served, tab, DRIVING | {"warnings": [f"warning {i}" for i in range(30)]})
    words = tab.text("#words").split("\n")
    assert words[0].endswith("warning 0")
    assert str(30 - (len(words) - 1)) in words[-1]
    assert len(words) > 3


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


@pytest.mark.parametrize("size", SIZES)
def test_before_engaging_the_plan_is_seen_as_it_will_be_driven(
    served: ServedPage, tab: Tab, size: tuple[int, int]
) -> None:
    check_plan(served, tab, size)


def test_dashes_are_ways_in_reverse_and_nothing_is_numbered_while_it_drives(served: ServedPage, tab: Tab) -> None:
    served.show_worked(PLANNED)
    show(served, tab, BEFORE, SIZES[1])
    tab.wait_for("document.body.innerText.includes('1234')")

    def orange() -> float:
        pixels = picture(tab, "plan")
        return float((np.abs(pixels - np.array([0xD3, 0x54, 0x00]) / 255.0).max(axis=-1) < 0.02).sum())

    both = orange()
    served.show_worked(PLANNED | {"plan": PLAN | {"reverse": []}})
    tab.wait_for("document.getElementById('reverse-key').hidden")
    assert both > orange() + 100
    served.show_worked(PLANNED)
    served.show(FIELD)
    tab.wait_for("document.body.innerText.includes('4 of 21')")
    tab.evaluate(LISTEN)
    tab.wait_for("window.drawn.length > 12")
    told = {text for text, _, _ in tab.evaluate("window.drawn")}
    assert "keep out 1" in told
    assert not told & {"1", "20", "visit"}
    # A message of which half is missing is no plan.
    served.show_worked(PLANNED | {"plan": {"swaths": []}})
    served.show(BEFORE)
    tab.wait_for("!document.body.innerText.includes('1234')")
    assert tab.complaints == []
