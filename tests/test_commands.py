"""Every command that the pages show is read by the parser, and run: here as it stands, or by a test named here."""

import hashlib
import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
import segyio

import benchmarks.__main__ as benchmarks
from canon.site import Site
from drawn_field import Drive, cover_rows, write_cover_run
from formats.samples import write_dt1
from lgprjax.cli import main
from lgprjax.cli.verbs import parsed
from lgprjax.formats import DriveLog, DriveWriter, read_fixes
from shown_commands import PAGES, ROOT, benchmarks_shown, names_a_verb_only, shown_in_blocks, shown_in_text, words_of
from vendor_sets import write_cmu, write_gprmax, write_iprb, write_segy

# What is run here, as it stands on its page and in its order: page, and which of its commands.
HERE = {
    "lines": ("README.md", r"(import lines|check odd|map build odd|register site).*"),
    "vendors": ("README.md", r"import (iprb|segy|cmu|gprmax) .*"),
    "road": ("README.md", r"(map build X|register road.map.h5 Y).*"),
    "map": ("docs/archive.md", r"(map build|map info|check) .*"),
    "field": ("docs/coverage.md", r"cover .*"),
    "transfer": ("docs/transfer.md", r"(import mcap|export) .*"),
}
_A_FIELD = "cli/test_run_field.py::test_a_field_is_driven_recorded_and_replayed_to_the_same_frames"
_STUDIES = "studies/test_shipped_studies.py::test_each_study_goes_on_with_the_file_of_the_one_before"
_IN_LOCK_STEP = "cli/test_run.py::test_in_lock_step_it_arrives_on_any_machine_and_tells_its_course"
# Commands that take minutes, a cluster, a run or a drive of their own: the test that runs them, on less of it.
ELSEWHERE = {
    r"(import X?LINE\*.DT1|map build day1|register day1).*": (
        "surveys/test_newcomer.py::test_four_commands_and_no_option"
    ),
    r"import signals .*": "formats/test_signal_tables.py::test_a_csv_file_becomes_a_drive_log",
    r"import mcap .*": "cli/test_export.py::test_there_and_back",
    r"import (rosbag .*|RECORDING.bag -o X.drive.h5)": (
        "formats/test_rosbag_import.py::test_a_bag_becomes_the_drive_that_mcap_becomes"
    ),
    r"compare .*": "test_commands.py::test_transfer",
    r"import grounded .*": "cli/test_cli.py::test_grounded_run_imports_by_the_documented_call",
    r"check X.drive.h5 --health": "cli/test_health.py::test_check_health_of_a_damaged_drive",
    r"view .*": "cli/test_view.py::test_every_vendors_file_becomes_a_picture",
    r"check FILE": "cli/test_cli.py::test_nan_and_inf_are_reported_by_check",
    r"import --help": "cli/test_cli.py::test_help",
    r"map update .*": "cli/test_map_update.py::test_what_it_says",
    r"map refine .*": "cli/test_map_refine.py::test_two_baselines_of_a_road",
    r"map verify .*": "cli/test_health.py::test_map_verify_writes_tables_and_a_picture",
    r"register .*--(workers|scheduler) .*": "batch/test_many_drives.py::test_a_cluster_gives_the_same_bits",
    r"register --window-m 4": "test_commands.py::test_lines",
    r"register --thresholds .*": "cli/test_thresholds.py::test_register_uses_it",
    r"thresholds .*": "cli/test_thresholds.py::test_the_file_says_what_it_was_found_on",
    r"route list MAP": "cli/test_route.py::test_routes_are_listed",
    r"run onboard/(simulated|mile).run.toml --simulate.*": "cli/test_run.py::test_a_simulated_run_becomes_a_drive_log",
    r"run CONFIG(.toml)?( --simulate)?": "cli/test_run.py::test_a_simulated_run_becomes_a_drive_log",
    r"run .* --replay RUN_FOLDER": "cli/test_run.py::test_the_run_replays_to_the_same_commands",
    r"run CONFIG.toml --preflight": "cli/test_run.py::test_a_preflight_names_what_is_not_in_order",
    r"run onboard/field.run.toml .*": _A_FIELD,
    r"run field.run.toml --start-line .*": _A_FIELD,
    r"run field.run.toml --resume": "worked/test_resume.py::test_a_run_that_was_cut_is_taken_up_where_it_ended",
    r"run field.* --end-line .*": "worked/test_resume.py::test_each_of_two_machines_goes_on_where_it_was_itself",
    r"register .* --track": "runtime/test_one_truth.py::test_the_fixes_of_a_run_are_those_of_its_drive_log",
    r"run --resume": "worked/test_resume.py::test_a_run_that_was_cut_is_taken_up_where_it_ended",
    r"cover record --(smooth|evidence).*": _A_FIELD,
    r"run CONFIG.toml --simulate --lockstep.*": _IN_LOCK_STEP,
    r"events .*": _IN_LOCK_STEP,
    r"doctor --onboard": "cli/test_real_time.py::test_a_machine_is_judged_by_what_was_measured",
    r"recover .*": "cli/test_recover.py::test_a_run_that_was_cut",
    r"cover plan RUN_FOLDER .*": _A_FIELD,
    r"cover plan hectare.geojson .*": "cli/test_cover.py::test_sides_and_moved_corners_are_told",
    r"simulate village .*": "test_public.py::test_a_session_runs_as_it_stands",
    r"simulate SITE.toml .*": "cli/test_simulate.py::test_drives_are_written_and_told",
    r"(simulate tuning|tune tuning|tune STUDY).*": _STUDIES,
    r"examples .*": "cli/test_examples.py::test_every_example_is_copied_and_can_be_used",
}
# Pages whose commands are run as they stand, in their order.
HOW_TO = {
    "docs/own_radar.md": "test_howto.py::test_bring_your_own_radar",
    "docs/own_vehicle.md": "test_howto.py::test_bring_your_own_vehicle",
    "docs/from_ros2.md": "test_howto.py::test_from_ros2",
}
# The reference's examples, verb by verb: it is made from the verbs, whose options the tests of each run.
REFERENCE = {
    r"demo.*": "test_public.py::test_a_session_runs_as_it_stands",
    r"import (dt1|dzt|mala) .*": "cli/test_cli.py::test_vendor_files_import",
    r"import (iprb|segy|cmu|gprmax) .*": "test_commands.py::test_vendors",
    r"import lines .*": "test_commands.py::test_lines",
    r"check .*": "test_commands.py::test_map",
    r"export .*": "test_commands.py::test_transfer",
    r"map (build|info) .*": "test_commands.py::test_map",
    r"register .*": "test_commands.py::test_road",
    r"route list .*": "cli/test_route.py::test_routes_are_listed",
    r"route (select|export) .*": "cli/test_route.py::test_a_stretch_is_selected_and_exported",
    r"cover plan .*": "cli/test_cover.py::test_the_plan_is_there_and_tells_its_figures",
    r"cover record .*": "cli/test_cover.py::test_the_record_tells_what_was_worked",
    r"cover export .*": "cli/test_cover.py::test_the_export_is_whole",
}


def _shown() -> list[tuple[str, str]]:
    return [
        (page.relative_to(ROOT).as_posix(), command)
        for page in PAGES
        for command in [*shown_in_blocks(page), *shown_in_text(page)]
    ]


def run(command: str) -> int:
    """Exit status of a command, its patterns resolved as a shell does."""
    words = []
    for word in words_of(command):
        found = sorted(str(path) for path in Path().glob(word)) if "*" in word else []
        words += found or [word]
    with pytest.raises(SystemExit) as stopped:
        main(words)
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


@pytest.mark.parametrize("command", sorted({command for _, command in _shown()}))
def test_the_parser_reads_what_is_shown(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lgprjax.cli.verbs._parse_and_run", lambda words: int(parsed(words) is None))
    assert run(command + " --help" if names_a_verb_only(command) else command) == 0


@pytest.mark.parametrize(("page", "command"), [each for each in _shown() if not names_a_verb_only(each[1])])
def test_what_is_shown_is_run(page: str, command: str) -> None:
    told = command.removeprefix("lgprjax ")
    if any(page == where and re.fullmatch(which, told) for where, which in HERE.values()):
        return
    known = ELSEWHERE | (REFERENCE if page == "docs/cli.md" else {})
    if page in HOW_TO:
        known = {r".*": HOW_TO[page]}
    tests = [test for which, test in known.items() if re.fullmatch(which, told)]
    assert tests, f"{page}: no test runs: {command}"
    file, _, name = tests[0].partition("::")
    assert f"\ndef {name}(" in (ROOT / "tests" / file).read_text(encoding="utf-8")


@pytest.mark.parametrize("command", sorted({command for page in PAGES for command in benchmarks_shown(page)}))
def test_the_benchmarks_read_what_is_shown(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(benchmarks, "run_verb", lambda _: 0)
    with pytest.raises(SystemExit) as stopped:
        benchmarks.main(shlex.split(command)[3:])
    assert stopped.value.code == 0


def _session(name: str, **stands_for: str) -> None:
    """Run the commands of a session in the present folder."""
    where, which = HERE[name]
    shown = [each for each in shown_in_blocks(ROOT / where) if re.fullmatch(which, each.removeprefix("lgprjax "))]
    assert len(shown) >= 2
    for command in shown:
        for short, full in stands_for.items():
            command = re.sub(rf"(?<!\S){re.escape(short)}(\.\.\.)?(?!\S)", full, command)
        assert run(command) == 0, command


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that commands are run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_lines(here: Path) -> None:
    # Five lines over one ground that changes slowly from line to line, which is all that a correlation needs.
    rng = np.random.default_rng(3)
    for number, line in enumerate(np.cumsum(rng.normal(size=(5, 120, 60)), axis=0), start=1):
        write_dt1(here / f"LINE{number:02d}.DT1", (2000.0 * line).astype(np.int16))
    _session("lines")
    assert (here / "result" / "report.html").is_file()


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
    where, which = HERE["vendors"]
    for command in shown_in_blocks(ROOT / where):
        if re.fullmatch(which, command.removeprefix("lgprjax ")):
            # Each is a session of its own: they all write X.drive.h5, in place of what was written before.
            assert run(f"{command} --force") == 0, command


@pytest.fixture(scope="module")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 120 scans of the live drive."""
    path = tmp_path_factory.mktemp("short") / "short.drive.h5"
    with (
        DriveLog.open(site.logs["live"]) as log,
        DriveWriter.create(path, log.description, channels=log.channels, dtype=np.uint8) as writer,
    ):
        writer.append(log.scan_time_s[:120], log.read_stored(0, 120)[0])
    return path


def test_road(here: Path, site: Site, short: Path) -> None:
    shutil.copyfile(site.logs["baseline_left"], here / "X.drive.h5")
    shutil.copyfile(short, here / "Y.drive.h5")
    _session("road")
    assert (read_fixes(here / "result" / "Y.fixes.h5")["code"] == "ok").any()


def test_map(here: Path, site: Site) -> None:
    for name in ("left", "right"):
        shutil.copyfile(site.logs[f"baseline_{name}"], here / f"{name}.drive.h5")
    _session("map", DRIVE="left.drive.h5 right.drive.h5")


def test_field(here: Path) -> None:
    (here / "out").mkdir()
    for name in ("onboard/field.geojson", "onboard/made_up_flail.vehicle.toml"):
        (here / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(ROOT / name, here / name)
    shown = [each for each in shown_in_blocks(ROOT / HERE["field"][0]) if " cover " in each]
    assert run(shown[0]) == 0
    # Two runs along the frame's east, as the runtime would have recorded them by that plan.
    digest = hashlib.sha256((here / "out" / "f.cover.geojson").read_bytes()).hexdigest()
    lines = tuple((line, 0.5 + line) for line in range(4))
    for name, drive, begin_s in (("one", Drive(lines[:2]), 0.0), ("two", Drive(lines[2:]), 600.0)):
        write_cover_run(here / name, *cover_rows(drive), begin_s=begin_s, plan_sha256=digest)
    for command in shown[1:]:
        filled = command.replace("RUN...", "one two").replace(
            "--vehicle ...", "--vehicle onboard/made_up_flail.vehicle.toml"
        )
        assert run(filled) == 0, command
    assert (here / "out" / "all.worked.h5").is_file()


def test_transfer(here: Path, site: Site, short: Path) -> None:
    shutil.copyfile(short, here / "X.drive.h5")
    assert run(f"lgprjax register {site.map} X.drive.h5 -o result") == 0
    shown = shown_in_blocks(ROOT / HERE["transfer"][0])
    exported = [each for each in shown if " export " in each]
    assert len(exported) == 7
    for command in exported:
        assert run(command) == 0
    for name in ("X.tum", "truth.tum"):
        assert np.loadtxt(here / name).shape[1] == 8
    (here / "X.mcap").rename("RECORDING.mcap")
    (imported,) = (each for each in shown if " import mcap " in each)
    assert run(f"{imported} --force") == 0
    assert run("lgprjax compare result result") == 0
