"""The folder of an archive: whose results it holds, what of a run is already there, one run at a time."""

import fcntl
import json
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from lgprjax import __version__
from lgprjax.archive.job_key import ArchiveRun, Job, key_of_job, settings_of
from lgprjax.archive.job_record import JobRecord, jobs_folder, read_record, write_record
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import atomic_output

_MARK = "archive.json"
_DERIVED = ("archive.csv", "archive.html")
_READERS = 4


class JobPlan(NamedTuple):
    """What a run has to do.

    Attributes:
        todo: jobs that are missing, or whose drive, settings, program or outputs changed.
        done: names of the drives that are as they would become.
        unreadable: drives that could not even be opened.
    """

    todo: list[Job]
    done: list[str]
    unreadable: list[InputError]


class _Mark(NamedTuple):
    """Whose results a folder holds: map, and the drives whose outputs are the archive's own."""

    map: str
    map_sha256: str
    drives: list[str]


def outputs_of(name: str) -> tuple[str, str]:
    """File names of a drive's outputs."""
    return f"{name}.fixes.csv", f"{name}.fixes.h5"


def drive_name(path: Path) -> str:
    """Name of a drive by its file."""
    return path.name.removesuffix(".drive.h5")


@contextmanager
def claimed(run: ArchiveRun, names: Sequence[str], *, force: bool) -> Iterator[None]:
    """Hold a folder for a run; what killed workers left half-written in it is removed.

    The folder is marked with its map and with the drives whose outputs are the archive's own and may be replaced.

    Args:
        run: the run.
        names: of its drives.
        force: replace results of another map, and outputs of other origin.

    Raises:
        InputError: it holds results of another map or files of other origin (without ``force``), it is no folder,
            or another run holds it.
    """
    folder = run.folder
    _ours(run, names, force)
    jobs_folder(folder).mkdir(parents=True, exist_ok=True)
    with (jobs_folder(folder) / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(folder, "output", "a folder that no other run works in", "another run") from None
        mark = _Mark(run.map_path.name, run.map_sha256, sorted(_ours(run, names, force).union(names)))
        with atomic_output(folder / _MARK, force=True) as temporary:
            temporary.write_text(json.dumps(mark._asdict(), indent=0) + "\n", encoding="utf-8")
        _clean(folder, mark.drives)
        try:
            yield
        finally:
            _clean(folder, mark.drives)


def plan_jobs(
    run: ArchiveRun, drives: Sequence[Path], *, force: bool, progress: Callable[[int], None] = lambda _: None
) -> JobPlan:
    """Read every drive's hash and find what is to be done; in a claimed folder.

    Args:
        run: the run.
        drives: logs of different names.
        force: do all of them anew.
        progress: told of drives looked at.
    """
    settings = settings_of(run.options)

    def look(drive: Path) -> Job | InputError:
        try:
            sha256 = file_hash(drive)
        except OSError as error:
            return InputError(drive, "file", "a readable file", error.strerror or str(error))
        return Job(drive_name(drive), drive.absolute(), sha256, key_of_job(sha256, run.map_sha256, settings))

    plan = JobPlan([], [], [])
    with ThreadPoolExecutor(max_workers=_READERS) as readers:
        for found in readers.map(look, drives):
            if isinstance(found, InputError):
                plan.unreadable.append(found)
            elif force or not _is_done(run.folder, found):
                plan.todo.append(found)
            else:
                plan.done.append(found.name)
            progress(1)
    return plan


def note_failure(run: ArchiveRun, job: Job, error: InputError, attempts: int) -> None:
    """Keep a record of a job that failed for good; a later run tries it again."""
    write_record(
        run.folder,
        JobRecord(
            name=job.name,
            state="failed",
            key=job.key,
            drive=job.drive.name,
            drive_sha256=job.drive_sha256,
            map=run.map_path.name,
            map_sha256=run.map_sha256,
            settings=settings_of(run.options),
            version=__version__,
            attempts=attempts,
            error=str(error),
        ),
    )


def _ours(run: ArchiveRun, names: Sequence[str], force: bool) -> set[str]:
    """Drives whose outputs in the folder are the archive's own. Raises ``InputError`` for what is not."""
    folder = run.folder
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    mark = _read_mark(folder / _MARK)
    ours = set() if mark is None else set(mark.drives)
    if force:
        return ours
    if mark is not None and mark.map_sha256 != run.map_sha256:
        expected = f"results of {run.map_path.name} as it is now, another folder, or --force"
        raise InputError(folder, "output", expected, f"results of another map, {mark.map}")
    foreign = [output for name in names if name not in ours for output in outputs_of(name)]
    for output in [*foreign, *(_DERIVED if mark is None else ())]:
        if (folder / output).exists():
            raise InputError(folder / output, "output", "a new file, or --force", "the file exists")
    return ours


def _is_done(folder: Path, job: Job) -> bool:
    """Whether a record tells of this very job, and its outputs are as it tells."""
    record = read_record(jobs_folder(folder) / f"{job.name}.json")
    if record is None or record.state != "done" or record.key != job.key:
        return False
    try:
        return all(file_hash(folder / name) == sha256 for name, sha256 in record.outputs.items())
    except OSError:
        return False


def _read_mark(path: Path) -> _Mark | None:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
        return _Mark(str(found["map"]), str(found["map_sha256"]), [str(name) for name in found["drives"]])
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, "file", "the mark of an archive", str(error)) from None


def _clean(folder: Path, names: Sequence[str]) -> None:
    """Remove what a worker that was killed had not yet renamed."""
    own = {f".{output}" for name in names for output in (*outputs_of(name), f"{name}.json")}
    for place in (folder, jobs_folder(folder)):
        for left in place.glob(".*.partial-*"):
            if left.name.rpartition(".partial-")[0] in own:
                left.unlink(missing_ok=True)
