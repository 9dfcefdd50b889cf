"""Whose results a folder holds, and what of a run is already there: keys, claims, plans."""

import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from archive_records import done, figures
from lgprjax.batch import ArchiveRun, JobPlan, claimed, key_of_job, note_failure, plan_jobs, settings_of
from lgprjax.batch.jobs import FileStamp, Job, jobs_folder, outputs_of, read_record, read_records, write_record
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.registration import RegisterOptions, Thresholds
from refusals import refusal_in, refused

OPTIONS = RegisterOptions(search_m=1.5)


def run_in(folder: Path, map_sha256: str = "one map", options: RegisterOptions = OPTIONS) -> ArchiveRun:
    return ArchiveRun(folder / "m.map.h5", map_sha256, FileStamp(0, 0), options, folder / "out", 1)


def drives_in(folder: Path, *names: str) -> list[Path]:
    paths = [folder / f"{name}.drive.h5" for name in names]
    for path in paths:
        path.write_bytes(b"scans of " + path.name.encode())
    return paths


def planned(run: ArchiveRun, drives: list[Path], *, force: bool = False) -> JobPlan:
    with claimed(run, [path.name.removesuffix(".drive.h5") for path in drives], force=force):
        return plan_jobs(run, drives, force=force)


def do(run: ArchiveRun, job: Job) -> None:
    """What a worker leaves."""
    for name in outputs_of(job.name):
        (run.folder / name).write_text(f"fixes of {job.key}")
    outputs = {name: file_hash(run.folder / name) for name in outputs_of(job.name)}
    told = {"key": job.key, "map_sha256": run.map_sha256, "outputs": outputs}
    write_record(run.folder, done(job.name, figures({"ok": 1})).model_copy(update=told))


def names_of(plan: JobPlan) -> tuple[list[str], list[str]]:
    return [job.name for job in plan.todo], plan.done


def test_the_key_changes_with_everything_that_a_result_depends_on() -> None:
    settings = settings_of(OPTIONS)
    keys = {
        key_of_job("d", "m", settings),
        key_of_job("e", "m", settings),
        key_of_job("d", "n", settings),
        *(
            key_of_job("d", "m", settings_of(changed))
            for changed in (
                replace(OPTIONS, search_m=2.0),
                replace(OPTIONS, window_m=4.0),
                replace(OPTIONS, risk=1e-5),
                replace(OPTIONS, time_scale=1.05),
                replace(OPTIONS, own_thresholds=Thresholds(6.0, 3.0)),
            )
        ),
    }
    assert len(keys) == 8
    assert key_of_job("d", "m", dict(reversed(settings.items()))) == key_of_job("d", "m", settings)
    told = json.loads(json.dumps(settings_of(replace(OPTIONS, own_thresholds=Thresholds(6.0, 3.0)))))
    assert told["own_thresholds"] == {
        **{"strength_by_chance": 6.0, "margin_by_chance": 3.0, "overlap": 0.6},
        **{"sigma_scale": 1.0},
    }


def test_only_what_is_missing_or_changed_is_to_be_done(tmp_path: Path) -> None:
    run, drives = run_in(tmp_path), drives_in(tmp_path, "a", "b", "c", "d", "e")
    first = planned(run, drives)
    assert names_of(first) == (["a", "b", "c", "d", "e"], [])
    for job in first.todo[:4]:
        do(run, job)
    note_failure(run, first.todo[4], InputError("e", "file", "x", "y"), 3)
    drives[1].write_bytes(b"recorded anew")
    (run.folder / "c.fixes.h5").unlink()
    (run.folder / "d.fixes.csv").write_text("changed by hand")
    assert names_of(planned(run, drives)) == (["b", "c", "d", "e"], ["a"])
    assert names_of(planned(run, drives, force=True)) == (["a", "b", "c", "d", "e"], [])
    wider = run_in(tmp_path, options=replace(OPTIONS, search_m=2.0))
    assert names_of(planned(wider, drives)) == (["a", "b", "c", "d", "e"], [])


def test_failures_are_kept_and_do_not_stop_other_drives(tmp_path: Path) -> None:
    run, drives = run_in(tmp_path), [*drives_in(tmp_path, "a"), tmp_path / "gone.drive.h5"]
    plan = planned(run, drives)
    assert names_of(plan) == (["a"], [])
    (unreadable,) = plan.unreadable
    refusal_in(unreadable).check("file", file=drives[1])
    assert read_records(run.folder)["gone"].state == "failed"
    error = InputError("a.drive.h5", "file", "x", "y")
    note_failure(run, plan.todo[0], error, 3)
    record = read_record(jobs_folder(run.folder) / "a.json")
    assert record is not None
    assert (record.state, record.attempts, record.error) == ("failed", 3, str(error))


def test_a_good_result_outlives_a_drive_that_can_no_longer_be_read(tmp_path: Path) -> None:
    run, drives = run_in(tmp_path), drives_in(tmp_path, "a", "b")
    for job in planned(run, drives).todo:
        do(run, job)
    # One is cut short, which its worker finds out, and one is gone.
    whole = drives[0].read_bytes()
    drives[0].write_bytes(whole[:5])
    drives[1].unlink()
    plan = planned(run, drives)
    assert names_of(plan) == (["a"], [])
    note_failure(run, plan.todo[0], InputError("a.drive.h5", "file", "x", "cut short"), 1)
    kept = read_records(run.folder)
    assert [record.state for record in kept.values()] == ["done", "done"]
    assert "cut short" in kept["a"].error
    assert "b.drive.h5: file:" in kept["b"].error
    # Readable again, it is up to date, and the failure is forgotten.
    drives[0].write_bytes(whole)
    assert names_of(planned(run, drives)) == ([], ["a"])
    assert not read_records(run.folder)["a"].error
    # Without its outputs nothing is left to keep.
    (run.folder / "b.fixes.csv").unlink()
    planned(run, drives)
    assert read_records(run.folder)["b"].state == "failed"


def test_results_of_another_map_are_refused_and_nothing_is_touched(tmp_path: Path) -> None:
    drives = drives_in(tmp_path, "a")
    do(run_in(tmp_path), planned(run_in(tmp_path), drives).todo[0])
    before = {path: path.read_bytes() for path in sorted((tmp_path / "out").rglob("*")) if path.is_file()}
    with refused("output", "--force", found="m.map.h5"):
        planned(run_in(tmp_path, "another map"), drives)
    assert {path: path.read_bytes() for path in sorted((tmp_path / "out").rglob("*")) if path.is_file()} == before
    assert names_of(planned(run_in(tmp_path, "another map"), drives, force=True)) == (["a"], [])


@pytest.mark.parametrize("name", ["a.fixes.h5", "archive.csv"])
def test_files_of_other_origin_are_refused(name: str, tmp_path: Path) -> None:
    run, drives = run_in(tmp_path), drives_in(tmp_path, "a")
    run.folder.mkdir()
    (run.folder / name).write_text("precious")
    with refused("output", "--force", file=run.folder / name):
        planned(run, drives)
    assert [path.name for path in run.folder.iterdir()] == [name]
    assert len(planned(run, drives, force=True).todo) == 1


def test_what_a_killed_run_left_is_its_own_and_what_others_left_stays(tmp_path: Path) -> None:
    """A run that ended between a drive's outputs and its record, and within an output."""
    run, drives = run_in(tmp_path), drives_in(tmp_path, "a")
    planned(run, drives)
    (run.folder / "a.fixes.csv").write_text("half of what was to come")
    ours = [run.folder / ".a.fixes.h5.partial-77", jobs_folder(run.folder) / ".a.json.partial-77"]
    other = run.folder / ".b.fixes.h5.partial-77"
    for path in (*ours, other):
        path.touch()
    assert names_of(planned(run, drives)) == (["a"], [])
    assert [path.exists() for path in (*ours, other)] == [False, False, True]


def test_one_run_at_a_time(tmp_path: Path) -> None:
    run = run_in(tmp_path)
    with (
        claimed(run, ["a"], force=False),
        refused(None, file="out", found=os.getpid()),
        claimed(run, ["b"], force=False),
    ):
        pass
    with claimed(run, ["b"], force=False):
        pass
    assert json.loads((run.folder / "archive.json").read_text())["drives"] == ["a", "b"]
