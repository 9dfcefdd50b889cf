"""Every command that the pages show is read by the parser, and its verb is run with each option that is shown with it.

They are run as they stand in the sessions below, the tutorial and the how-to pages, by the story, or by a test named
here.
"""

import hashlib
import re
import shlex
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import segyio

import benchmarks.__main__ as benchmarks
from canon.commands import run, shell, succeed
from canon.story import COMMANDS, story_of
from drawn_field import Drive, cover_rows, write_cover_run
from lgprjax.cli.command import parsed
from lgprjax.cli.verbs import every_verb
from shown_commands import (
    HOW_TO,
    PAGES,
    ROOT,
    TUTORIAL,
    benchmarks_shown,
    names_a_verb_only,
    python_of,
    run_as_it_stands,
    shown_in_blocks,
    shown_in_text,
    words_of,
)
from vendor_sets import write_cmu, write_gprmax, write_iprb, write_segy

# What is run here, as it stands on its page and in its order: page, and which of its commands.
HERE = {
    "vendors": ("docs/surveys.md", r"import (iprb|segy|cmu|gprmax) .*"),
    "field": ("docs/coverage.md", r"cover (?!record RUN ).*"),
    "transfer": ("docs/transfer.md", r"(import mcap|export) .*"),
}
_A_FIELD = "cli/test_run_field.py::test_a_field_is_driven_recorded_and_replayed_to_the_same_frames"
_RUN = "cli/test_run.py::test_in_lock_step_it_arrives_on_any_machine_and_tells_its_course"
_REAL_TIME = "../validation/loops/test_real_time.py::test_in_real_time_nothing_is_compiled_once_a_process_is_ready"
_RESUMED = "worked/test_resume.py::test_a_run_that_was_cut_is_taken_up_where_it_ended"
# Verbs that take minutes, a cluster, a run or a drive of their own: the tests that run them, on less of it.
ELSEWHERE = {
    "calibrate": ("cli/test_calibrate.py",),
    "locate": ("batch/test_locate.py",),
    "radar lookup": ("cli/test_radar.py",),
    "radar plate": ("cli/test_radar.py",),
    "demo": (
        "cli/test_cli.py::test_what_cannot_be_used_costs_nothing",
        "test_public.py::test_a_session_runs_as_it_stands",
    ),
    "examples": ("cli/test_examples.py::test_every_example_is_copied_and_can_be_used",),
    "doctor": (
        "cli/test_help.py::test_figures_go_to_standard_output_alone",
        "cli/test_real_time.py::test_a_machine_is_judged_by_what_was_measured",
    ),
    "import dt1": ("cli/test_cli.py::test_vendor_files_import", "formats/test_surveys.py"),
    "import dzt": (
        "cli/test_cli.py::test_vendor_files_import",
        "cli/test_import.py::test_cut_line_is_told_in_the_table",
    ),
    "import mala": ("cli/test_cli.py::test_vendor_files_import", "formats/test_surveys.py"),
    "import segy": ("cli/test_wrong_imports.py::test_what_looks_odd_is_said",),
    "import iprb": ("cli/test_wrong_imports.py::test_what_looks_odd_is_said",),
    "import lines": (
        "batch/test_real_survey.py::test_four_commands_and_no_option",
        "cli/test_wrong_imports.py::test_what_looks_odd_is_said",
    ),
    "import grounded": ("cli/test_cli.py::test_grounded_run_imports_by_the_documented_call",),
    "import cmu": ("cli/test_import.py::test_import_check_and_what_is_in_it",),
    "import gprmax": ("cli/test_import.py::test_import_check_and_what_is_in_it",),
    "import mcap": ("cli/test_export.py::test_options_reach_the_drive_and_notes_the_user",),
    "import rosbag": (
        "formats/test_rosbag_import.py::test_a_bag_becomes_the_drive_that_mcap_becomes",
        "cli/test_export.py::test_options_reach_the_drive_and_notes_the_user",
    ),
    "import signals": ("formats/test_signal_tables.py::test_a_csv_file_becomes_a_drive_log",),
    "view": ("cli/test_view.py::test_pictures_go_where_they_are_told",),
    "check": ("cli/test_health.py::test_check_health_of_a_damaged_drive",),
    "map build": (
        "cli/test_register_survey.py::test_what_a_survey_line_cannot_know_is_told",
        "formats/test_map_file.py",
    ),
    "map update": ("cli/test_map_update.py::test_what_it_says",),
    "map refine": ("cli/test_map_refine.py::test_two_baselines_of_a_road",),
    "map verify": ("cli/test_health.py::test_map_verify_writes_tables_and_a_picture",),
    "register": (
        "batch/test_many_drives.py::test_two_workers_one_of_them_killed_give_the_same_bits",
        "cli/test_thresholds.py::test_register_uses_it",
        "cli/test_register_many.py::test_an_address_of_no_scheduler_makes_no_client",
        "runtime/test_one_truth.py::test_the_fixes_of_a_run_are_those_of_its_drive_log",
    ),
    "thresholds": ("cli/test_thresholds.py::test_register_uses_it",),
    "route select": ("cli/test_route.py::test_a_stretch_is_selected_and_exported",),
    "run": (_A_FIELD, _RUN, _RESUMED, _REAL_TIME, "cli/test_run.py::test_a_preflight_names_what_is_not_in_order"),
    "events": (_RUN,),
    "recover": ("cli/test_recover.py::test_nothing_can_be_saved", "cli/test_recover.py::test_a_run_that_was_cut"),
    "cover plan": ("cli/test_cover.py::test_gaps_are_planned_again",),
    "cover record": ("cli/test_cover.py::test_the_record_tells_what_was_worked", _A_FIELD),
    "tune study": ("cli/test_tune.py::test_a_study_gives_a_new_vehicle_file",),
    "tune compare": ("studies/test_fleet.py::test_the_command_writes_a_table_and_two_pictures",),
}


# Examples of the help, with the pages.
EXAMPLES = Path("--help")


def _shown(page: Path) -> list[str]:
    if page == EXAMPLES:
        return [f"lgprjax {example}" for _, verb in every_verb() for example in verb.examples]
    return [*shown_in_blocks(page), *shown_in_text(page)]


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Words of the commands that the parser read, which are not run; a format that was recognised is among them."""
    words = list[list[str]]()

    def note(given: list[str]) -> int:
        words.append(list(given))
        return int(parsed(given) is None)

    monkeypatch.setattr("lgprjax.cli.command._parse_and_run", note)
    return words


def _verb_of(words: list[str]) -> str:
    verbs = dict(every_verb())
    two = " ".join(words[:2])
    return two if two in verbs else words[0]


def _options_of(words: list[str]) -> set[str]:
    return {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)} - {"-o", "--output"}


def test_what_is_shown_is_read_and_run(read: list[list[str]]) -> None:
    executed = [shlex.split(command) for command in COMMANDS]
    executed += [words_of(each) for page in (TUTORIAL, *HOW_TO) for each in run_as_it_stands(page)]
    executed += [words_of(each) for name in HERE for each in _session(name)]
    for words in executed:
        assert run(*words).status == 0, words
    known: dict[str, set[str]] = {}
    for words in read:
        known.setdefault(_verb_of(words), set()).update(_options_of(words))
    missing = []
    for page in (*PAGES, EXAMPLES):
        for command in _shown(page):
            read.clear()
            bare = names_a_verb_only(command)
            assert run(*words_of(command), *(["--help"] if bare else [])).status == 0, f"{page}: {command}"
            if not read:
                continue
            verb = _verb_of(read[0])
            assert verb in known or verb in ELSEWHERE, f"{page}: no test runs: {command}"
            left = _options_of(read[0]) - known.get(verb, set())
            told = "".join(_source(test) for test in ELSEWHERE.get(verb, ()))
            # In Python an option is an argument.
            left = {option for option in left if not re.search(rf"{option}|{option[2:].replace('-', '_')}", told)}
            missing += [(page.name, command, option) for option in sorted(left)]
    assert missing == []


@cache
def _source(test: str) -> str:
    """Text of the file of a test that there is."""
    file, _, name = test.partition("::")
    text = (ROOT / "tests" / file).read_text(encoding="utf-8")
    assert not name or f"\ndef {name}(" in text, test
    return text


def test_the_benchmarks_read_what_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmarks, "run_verb", lambda _: 0)
    shown = {command for page in PAGES for command in benchmarks_shown(page)}
    assert len(shown) > 5
    for command in shown:
        with pytest.raises(SystemExit) as stopped:
            benchmarks.main(shlex.split(command)[3:])
        assert stopped.value.code == 0, command


def _session(name: str) -> list[str]:
    where, which = HERE[name]
    shown = [each for each in shown_in_blocks(ROOT / where) if re.fullmatch(which, each.removeprefix("lgprjax "))]
    assert len(shown) >= 4
    return shown


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that commands are run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_vendors(here: Path) -> None:
    write_iprb(here)
    (segy,) = write_segy(here)
    with segyio.open(str(segy), "r+", ignore_geometry=True) as store:
        for index in range(12):
            store.header[index] = {73: 50_000_000 + 5 * index, 77: 531_600_000}
    segy.rename("LINE.sgy")
    write_cmu(here)[0].rename("SEQUENCE_DIR")
    for number, path in enumerate(write_gprmax(here), start=1):
        path.rename(f"model{number}.h5")
    for command in _session("vendors"):
        (words,) = shell(shlex.join(["lgprjax", *words_of(command)]).replace("'", ""))
        # Each is a session of its own: they all write X.drive.h5, in place of what was written before.
        succeed(*words, "--force")


def test_field(here: Path) -> None:
    (here / "out").mkdir()
    for name in ("onboard/field.geojson", "onboard/made_up_flail.vehicle.toml"):
        (here / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(ROOT / name, here / name)
    first, *others = _session("field")
    succeed(*words_of(first))
    # Two runs along the frame's east, as the runtime would have recorded them by that plan.
    digest = hashlib.sha256((here / "out" / "f.cover.geojson").read_bytes()).hexdigest()
    lines = tuple((line, 0.5 + line) for line in range(4))
    for name, drive, begin_s in (("one", Drive(lines[:2]), 0.0), ("two", Drive(lines[2:]), 600.0)):
        write_cover_run(here / name, *cover_rows(drive), begin_s=begin_s, plan_sha256=digest)
    for command in others:
        filled = command.replace("RUN...", "one two")
        filled = filled.replace("--vehicle ...", "--vehicle onboard/made_up_flail.vehicle.toml")
        succeed(*words_of(filled))
    assert (here / "out" / "all.worked.h5").is_file()


def test_transfer(here: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    story = story_of(tmp_path_factory).folder
    (here / "result").mkdir()
    shutil.copyfile(story / "drives/live.drive.h5", here / "X.drive.h5")
    # The log's own name is in the fixes only as a digest of its contents.
    shutil.copyfile(story / "default/live.fixes.h5", here / "result" / "X.fixes.h5")
    shown = _session("transfer")
    exported = [each for each in shown if " export " in each]
    assert len(exported) == 7
    for command in exported:
        succeed(*words_of(command))
    for name in ("X.tum", "truth.tum"):
        assert np.loadtxt(here / name).shape[1] == 8
    (here / "X.mcap").rename("RECORDING.mcap")
    (imported,) = (each for each in shown if " import mcap " in each)
    succeed(*words_of(imported), "--force")
    scope: dict[str, Any] = {}
    (text,) = python_of(ROOT / "docs/transfer.md")
    exec(text, scope)
    assert len(scope["beside"]) == len(scope["ok"]) > 0
    assert scope["beside"]["valid_channels"].notna().all()
