"""What the command line makes of a small site: every scan's code and place, and every file's structure, as they were.

On one machine two runs of the story agree to the bit; between processors of one kind of instructions
(``ONE_ARITHMETIC``) they nearly do, and a tolerance is kept for what they do not promise: 1 mm of place, and codes that
differ for 0.2 % of all scans at most, for a scan may lie so near to a threshold that a last bit decides. Such a scan's
numbers are not compared. A climb keeps the best of a few poses, and a last bit may choose another: between two
processors 4 of 190 places moved by up to 2 mm, and 11 headings by up to 0.17 degrees.
"""

import platform
from typing import Any

import numpy as np
import pandas as pd
import pytest

from canon.story import Story
from frozen.harness import DATA, read_json
from frozen.made import LOCATED, fixes_of
from frozen.structure import FILES, messages_of, schema_digests, structure_of

on_x86 = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="fixes are frozen for x86-64")
_DEGREE_M = 111_320.0
_WITHIN = {
    **{"height_m": 2e-3, "heading_deg": 0.01, "sigma_along_m": 1e-3, "sigma_cross_m": 1e-3, "correlation": 1e-3},
    **{"time_scale": 1e-6, "window_m": 0.0},
}
_OTHERS, _FARTHEST = 0.1, 20.0
"""Share of the fixes that another processor may move by more than that, and by how many times it."""


@pytest.fixture(scope="module")
def held() -> pd.DataFrame:
    """Fixes as they were."""
    return pd.read_csv(DATA / "fixes.csv")


@pytest.fixture(scope="module")
def found(story: Story) -> pd.DataFrame:
    """Fixes of now."""
    return fixes_of(story.folder)


@on_x86
def test_every_scan_has_its_code(found: pd.DataFrame, held: pd.DataFrame) -> None:
    assert len(found) == len(held)
    assert (found["of"] == held["of"]).all()
    assert (found["scan"] == held["scan"]).all()
    other = found["code"] != held["code"]
    assert other.mean() <= 0.002, found[other].join(held["code"].rename("held"))


@on_x86
@pytest.mark.parametrize("which", LOCATED)
def test_places_are_where_they_were(which: str, found: pd.DataFrame, held: pd.DataFrame) -> None:
    same = (held["of"] == which) & (found["code"] == held["code"])
    now, then = found[same], held[same]
    for name in ("latitude_deg", *_WITHIN):
        assert (now[name].isna() == then[name].isna()).all(), name
    north = (now["latitude_deg"] - then["latitude_deg"]) * _DEGREE_M
    east = (now["longitude_deg"] - then["longitude_deg"]) * _DEGREE_M * np.cos(np.radians(then["latitude_deg"]))
    placed, ok = now["latitude_deg"].notna(), then["code"] == "ok"
    assert placed.any()
    assert ok.any() == (which != "default/impostor")
    off_m = np.hypot(east, north)
    apart = {"place": (off_m, 1e-3)}
    apart |= {name: ((now[name] - then[name]).abs(), within) for name, within in _WITHIN.items()}
    for name, (off, within) in apart.items():
        told = f"{name}: {(off[ok] > within).sum()} of {ok.sum()} beyond {within:g}, {off[ok].max():g} at most"
        assert not ok.any() or (off[ok] > within).mean() <= _OTHERS, told
        assert (off[ok] <= _FARTHEST * within).all(), told
    # A place that is not ok is one of several that match alike.
    assert (off_m[placed & ~ok] > 1e-3).mean() <= _OTHERS or (ok | ~placed).all()


def test_every_command_ends_as_it_should(story: Story) -> None:
    """A command that stands there again, and is not forced, is refused and writes nothing."""
    told = [step.words.partition(" --json")[0] for step in story.steps]
    again = [words in told[:place] for place, words in enumerate(told)]
    assert again.count(True) == 5
    for step, refused in zip(story.steps, again, strict=True):
        assert step.done.status == refused, step.done.err
        told_only = step.words.startswith(("check ", "map info ")) and ".json" not in step.words
        assert bool(step.wrote) != (refused or told_only), step.words
        if refused:
            assert step.done.refusal.place == "output"
            assert "--force" in step.done.refusal.expected


@pytest.mark.parametrize("kind", FILES)
def test_a_file_is_built_as_it_was(kind: str, story: Story) -> None:
    structures: dict[str, Any] = read_json("formats.json")
    assert structure_of(story.folder / FILES[kind]) == structures[kind]


def test_messages_are_of_the_same_types(story: Story) -> None:
    assert messages_of(story.folder / "live.mcap") == read_json("messages.json")


def test_the_schema_is_the_same() -> None:
    assert schema_digests() == read_json("schemas.json")
