"""Messages can be followed: options that they name are accepted by the verb that prints them, or that they name."""

import re
from pathlib import Path

import pytest

from canon.commands import run, succeed
from formats.mcap_sample import write_curved
from lgprjax.formats import export_mcap
from printed_options import messages, unknown_options

_ROOT = Path(__file__).parents[1]
# Texts that a verb refers to and never prints: by place, and why.
NOT_PRINTED = {
    "recordings.drives.SweepDrive.chain": "map build and map update alone choose the chain of a map",
    "recordings.drives.TraceDrive.chain": "map build and map update alone choose the chain of a map",
    "cli.imports.finished": "each line is for verbs that have its option",
    "cli.register._claim": "the demo replaces its own folder",
    "simulation.sites.output_paths": "the demo replaces its own folder",
    "formats.store.atomic_output": "the demo replaces its own folder",
    "report.html.DECLINES": "the page of the demo, which is one of register",
    "formats.line_findings._time_zeros": "a single line, which view draws, agrees with itself",
    "formats.line_layout.check_rising": "import gprmax has checked its positions before",
    "formats.line_layout.own_distances_m": "traces of gprMax have positions",
    "formats.settings_files.read_thresholds": "register and thresholds alone give another window",
    "formats.survey_layout.lay_out": "one file of one channel is one line",
    "formats.surveys._read_lines": "DT1 and MALA files have one channel",
    "formats.surveys.read_profile": "refuses an option that was given",
    "formats.surveys._tape": "refuses an option that was given",
    "formats.vendors.line_files._CHOICE": "of DZT files",
    "formats.vendors.segy._decoded": "refuses an option that was given",
    "formats.vendors.segy._interval": "of SEG-Y files",
    "worked.plans.plan_field": "cover plan alone prints the notes of a plan",
}


def test_every_option_that_is_named_is_accepted() -> None:
    wrong, used, texts = [], set(), set()
    for message in messages():
        place = f"{message.module}.{message.name}".removeprefix("lgprjax.")
        texts.add((place, message.text))
        unknown = unknown_options(message.text, message.verb)
        if unknown and place in NOT_PRINTED:
            used.add(place)
        elif unknown:
            wrong.append((message.verb, place, unknown, message.text))
    assert wrong == []
    assert used == set(NOT_PRINTED)
    assert len(texts) > 80


def test_the_check_finds_what_cannot_be_followed() -> None:
    assert unknown_options("a length, or --length-m", "import gprmax") == ["--length-m"]
    assert unknown_options("a length, or --length-m", "import segy") == []
    assert unknown_options("lgprjax import --partial reads the whole ones", "view") == []
    assert unknown_options("read them with lgprjax import --whole", "view") == ["--whole"]
    assert unknown_options("run --resume, or --search-m", "events") == ["--search-m"]


def test_every_page_that_a_message_names_is_there() -> None:
    named = {
        page
        for path in (_ROOT / "lgprjax").rglob("*.py")
        for page in re.findall(r"\bdocs/\w+\.md", path.read_text(encoding="utf-8"))
    }
    assert {"docs/compatibility.md", "docs/own_radar.md"} <= named
    assert [page for page in sorted(named) if not (_ROOT / page).is_file()] == []


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_recording_that_is_cut_is_told_so(here: Path) -> None:
    """Before its first whole chunk, within a later one, and without its end: what there is, and what repairs it."""
    write_curved(here / "a.drive.h5", "int16", scans=60)
    export_mcap(here / "a.drive.h5", here / "a.mcap")
    whole = (here / "a.mcap").read_bytes()
    for size in (60, 300, len(whole) // 9):
        Path("cut.mcap").write_bytes(whole[:size])
        refusal = run("import", "cut.mcap", "-o", "x.drive.h5").refusal
        refusal.check("topics", found="cut")
        refusal.check("topics", found="mcap recover cut.mcap")
    Path("cut.mcap").write_bytes(whole[:-200])
    assert "too early" in succeed("import", "cut.mcap", "-o", "x.drive.h5")


def test_a_bag_without_its_metadata_is_told_so(here: Path) -> None:
    write_curved(here / "a.drive.h5", "int16", scans=60)
    export_mcap(here / "a.drive.h5", here / "a.db3")
    Path("a.db3").rename("bag")
    (here / "bag" / "metadata.yaml").unlink()
    (inside,) = Path("bag").glob("*.db3")
    for words in (("import", "rosbag", "bag"), ("import", "rosbag", inside), ("import", inside)):
        run(*words, "-o", "x.drive.h5").refusal.check("bag", "metadata.yaml", "reindex", "ros2")
    assert "reindex" in run("import", "bag", "-o", "x.drive.h5").err
    # Whole again, but damaged.
    export_mcap(here / "a.drive.h5", here / "b.db3")
    (inside,) = Path("b.db3").glob("*.db3")
    inside.write_bytes(inside.read_bytes()[:5000])
    run("import", "b.db3", "-o", "x.drive.h5").refusal.check("file", "ros2 bag reindex b.db3")


@pytest.mark.parametrize(
    ("name", "page"),
    [(f"a.{each}", "docs/compatibility.md") for each in ("dt", "3dra")]
    + [(f"a.{each}", "docs/own_radar.md") for each in ("npy", "mat", "vol")],
)
@pytest.mark.usefixtures("here")
def test_a_format_that_a_page_explains_points_to_it(name: str, page: str) -> None:
    Path(name).write_bytes(b"x")
    done = run("import", name, "-o", "x.drive.h5")
    assert done.status == 2
    assert page in done.err
