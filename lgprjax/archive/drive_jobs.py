"""One process's share of an archive run: the map opened once, the programs compiled once, drive after drive."""

import os
import socket
import sys
import time
import traceback

from lgprjax import __version__
from lgprjax.archive.archive_folder import outputs_of
from lgprjax.archive.drive_figures import cells_of, figures_of
from lgprjax.archive.held_ground import HeldGround
from lgprjax.archive.job_key import ArchiveRun, Job, settings_of, stamp_of
from lgprjax.archive.job_record import JobCost, JobRecord, write_record
from lgprjax.archive.registering import RegisteredDrive, register_log, write_registered
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, MapFile
from lgprjax.process_cost import count_compiles, peak_rss_mb

HELD_TILES = 16
"""Tiles, and as many columns, that a worker holds from drive to drive."""


class DriveJobs:
    """What a worker does; close it when done.

    Args:
        run: the run.

    Raises:
        InputError: the map cannot be opened, or is no longer the file that the run began with.
    """

    def __init__(self, run: ArchiveRun) -> None:
        self._run = run
        self._compiled, self._counted = count_compiles(), 0
        self._source = MapFile.open(run.map_path)
        try:
            if stamp_of(run.map_path) != run.map_stamp:
                raise InputError(run.map_path, "file", "the file that the run began with", "one written since")
            self._held = HeldGround(self._source, run.options, tiles=HELD_TILES)
        except BaseException:
            self._source.close()
            raise

    def close(self) -> None:
        """Close the map."""
        self._source.close()

    def do(self, job: Job, attempt: int = 1) -> InputError | None:
        """Register a drive; outputs and record are written, the record last.

        Returns:
            why it failed; None where it is done. A defect is told on standard error besides.

        Raises:
            MemoryError: there is too little; of no use to the next drive either.
        """
        try:
            self._register(job, attempt)
        except InputError as error:
            return error
        except Exception as error:
            if isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error):
                raise MemoryError(str(error)) from None
            traceback.print_exc(file=sys.stderr)
            return InputError(job.drive, "registration", "a result", f"a defect: {type(error).__name__}: {error}")
        return None

    def _register(self, job: Job, attempt: int) -> None:
        began, run = time.perf_counter(), self._run
        with DriveLog.open(job.drive) as log:
            # What was read must be what the job is named by; the open file stays the same if another takes its place.
            if file_hash(job.drive) != job.drive_sha256:
                raise InputError(job.drive, "file", "the file that the run began with", "one written since")
            drive = register_log(self._source, log, run.options, held=self._held)
            sha256 = (run.map_sha256, job.drive_sha256)
            write_registered(drive, self._source, log, run.options, run.folder, force=True, sha256=sha256)
        write_record(run.folder, self._record(job, drive, time.perf_counter() - began, attempt))

    def _record(self, job: Job, drive: RegisteredDrive, seconds: float, attempt: int) -> JobRecord:
        run, before = self._run, self._counted
        self._counted = self._compiled()
        return JobRecord(
            name=job.name,
            state="done",
            key=job.key,
            drive=job.drive.name,
            drive_sha256=job.drive_sha256,
            map=run.map_path.name,
            map_sha256=run.map_sha256,
            settings=settings_of(run.options),
            version=__version__,
            attempts=attempt,
            outputs={name: file_hash(run.folder / name) for name in outputs_of(job.name)},
            figures=figures_of(drive),
            cells=cells_of(drive),
            cost=JobCost(
                seconds=seconds,
                search_s=1e-3 * drive.milliseconds_per_scan * len(drive.table),
                compiled=self._counted - before,
                peak_rss_mb=peak_rss_mb(),
                worker=f"{socket.gethostname()}:{os.getpid()}",
            ),
        )
