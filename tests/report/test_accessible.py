"""Colours told apart by every eye and in print, and texts that stand out.

Deficient colour vision as in Machado, Oliveira & Fernandes 2009 (severity 1, on linear RGB); differences are those of
CIE 1976 L*a*b*, of which about 2 are just noticeable.
"""

import re
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex

from lgprjax.report.coverage import COLOURS as GROUND_COLOURS
from lgprjax.report.html import _STYLE as REPORT_STYLE
from lgprjax.report.map import PASSES
from lgprjax.report.style import CODE_COLOURS, CODE_HATCHES, INK, MUTED
from lgprjax.report.zoom_page import _MARKS

_SEEN = {
    "normal": np.eye(3),
    "protanopia": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deuteranopia": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritanopia": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}
_TO_XYZ = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)


def _linear(colour: str) -> np.ndarray:
    values = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _lab(linear: np.ndarray) -> np.ndarray:
    x, y, z = _TO_XYZ @ np.clip(linear, 0.0, 1.0) / np.array([0.95047, 1.0, 1.08883])
    bent = [np.cbrt(each) if each > 0.008856 else 7.787 * each + 16.0 / 116.0 for each in (x, y, z)]
    return np.array([116.0 * bent[1] - 16.0, 500.0 * (bent[0] - bent[1]), 200.0 * (bent[1] - bent[2])])


@pytest.mark.parametrize(("colours", "least"), [(list(CODE_COLOURS.values()), 15.0), (GROUND_COLOURS, 20.0)])
def test_codes_and_states_of_ground_are_told_apart_by_every_eye(colours: Sequence[str], least: float) -> None:
    for eye, seen in _SEEN.items():
        lab = [_lab(np.asarray(seen) @ _linear(colour)) for colour in colours]
        assert min(float(np.linalg.norm(a - b)) for a, b in combinations(lab, 2)) > least, eye


def test_codes_are_told_apart_in_a_print_without_colours() -> None:
    light = {code: _lab(_linear(colour))[0] for code, colour in CODE_COLOURS.items()}
    alike = [(a, b) for a, b in combinations(light, 2) if abs(light[a] - light[b]) < 10.0]
    assert alike
    assert [pair for pair in alike if CODE_HATCHES[pair[0]] == CODE_HATCHES[pair[1]]] == []
    # On the page of scans their shapes do.
    assert len(set(_MARKS.values())) == len(_MARKS)
    assert set(_MARKS) == set(CODE_COLOURS) - {"no_window"}
    light_of_ground = sorted(_lab(_linear(colour))[0] for colour in GROUND_COLOURS)
    assert float(np.diff(light_of_ground).min()) > 10.0
    # More passes over a map are darker.
    assert np.all(np.diff([_lab(_linear(to_hex(colour)))[0] for colour in PASSES]) < -8.0)


def _contrast(one: str, other: str) -> float:
    """WCAG 2.1: of relative luminances."""
    low, high = sorted(float(_TO_XYZ[1] @ _linear(each)) for each in (one, other))
    return (high + 0.05) / (low + 0.05)


def test_texts_stand_out_from_their_ground() -> None:
    assert min(_contrast(each, "#ffffff") for each in (INK, MUTED)) >= 4.5
    for rule in re.findall(r":root \{([^}]*--ground[^}]*)\}", REPORT_STYLE):
        colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{3,6})", rule))
        full = {name: "#" + "".join(2 * digit for digit in c[1:]) if len(c) == 4 else c for name, c in colours.items()}
        assert min(_contrast(full[name], full["ground"]) for name in ("ink", "soft", "link")) >= 4.5


def test_links_of_the_site_stand_out_from_its_pages() -> None:
    style = (Path(__file__).parents[2] / "docs" / "extra.css").read_text(encoding="utf-8")
    colours = re.findall(r"--md-(?:primary-fg|typeset-a)-color: (#[0-9a-f]{6})", style)
    assert len(colours) == 2
    assert min(_contrast(each, "#ffffff") for each in colours) >= 4.5
