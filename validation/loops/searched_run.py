"""A recorded run whose registration has searched, and its fixes beside those of its drive log."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from canon.site import Site
from formats.run_log_sample import head_bytes, own_bytes, record_bytes
from lgprjax.batch import agreement, on_board_of, options_as_provenance, register_log
from lgprjax.batch.register import RegisteredDrive
from lgprjax.formats import DriveLog, MapFile, check_file, read_run, read_vehicle
from lgprjax.recordings import write_run_drive
from lgprjax.registration import Code
from lgprjax.run_records import FIX, Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.registration.program import ScanQueue, array_place
from lgprjax.runtime.registration.scans import SCAN_MESSAGES, RadarSelf
from lgprjax.runtime.registration.search import Search, options_of
from lgprjax.runtime.stamps import StampClock
from lgprjax.wire import decode
from recordings.run_sample import MONO_NS, run_of_drive

RESTART = 0.66
"""Share of the scans until the registration process is started anew."""


def searched_run(ground: Site, folder: Path, scans: int, search: str = "exhaustive") -> None:
    """Record the ground's live drive as a run whose registration has searched its first scans."""
    run_of_drive(ground, "live", folder)
    for path in (folder / "config.toml", folder.parent / "CONFIG.toml"):
        path.write_text(f'{path.read_text()}\n[registration]\nsearch = "{search}"\n')
    config = read_config(folder.parent / "CONFIG.toml")
    records = [unpack(data) for _, data in read_run(folder)]
    parts = [head_bytes(0, 0, mono_ns=MONO_NS)]
    with MapFile.open(ground.map) as source:
        for number, record in enumerate(_searched(records, config, source, scans)):
            parts.append(record_bytes(number, pack(record)))
    parts.append(own_bytes(len(parts) - 1, end="ended"))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))


def _searched(records: list[Record], config: RuntimeConfig, source: MapFile, most: int) -> Iterator[Record]:
    """The records of a run, and those of its registration, which gets to it whenever a busy computer lets it."""
    rng, vehicle = np.random.default_rng(5), read_vehicle(config.path(config.vehicle))
    said, clock, queue, scans = RadarSelf(), StampClock(), None, 0
    for record in records:
        yield record
        if record.kind is RecordKind.PRIOR and queue is not None:
            queue.priors.take(record.payload)
        elif record.kind is RecordKind.PORT_IN and record.source is Source.RADAR:
            frame = decode(record.payload)
            if frame.name in SCAN_MESSAGES and scans < most:
                if scans in (0, round(RESTART * most)):
                    assert said.description is not None
                    search = Search(config, vehicle, source, source, said.description, said.lookup)
                    search.ahead.close()
                    queue = ScanQueue(search, clock, *array_place(vehicle))
                scans += 1
                assert queue is not None
                queue.take(frame, record.mono_ns)
            elif frame.name not in SCAN_MESSAGES:
                said.take(frame)
        while queue is not None and rng.random() < 0.3 and (found := queue.step()) is not None:
            for kind, payload in found.records:
                yield Record(kind, Source.REGISTRATION, 0, record.mono_ns, payload)


def check_one_truth(ground: Site, run: Path, path: Path, scans: int) -> RegisteredDrive:
    """Write the run's drive log and register it again: its fixes are those of the recording.

    Args:
        ground: on which it was driven.
        run: of ``searched_run``.
        path: of the drive log to be written.
        scans: that were searched.

    Returns:
        The drive registered again.
    """
    options = options_of(read_config(run.parent / "CONFIG.toml"))
    with MapFile.open(ground.map) as source:
        write_run_drive(
            run,
            path,
            source=source,
            vehicle=read_vehicle(run.parent / "v.vehicle.toml"),
            position_sigma_m=0.02,
            registration=options_as_provenance(options),
        )
        assert check_file(path) == []
        with DriveLog.open(path) as log:
            again = register_log(source, log, options)
            searched = on_board_of(log, source.description.frame)
    rows = [
        record.payload for record in map(unpack, (data for _, data in read_run(run))) if record.kind is RecordKind.FIX
    ]
    fixes = np.frombuffer(b"".join(rows), FIX)
    own = fixes["code"] != Code.NO_WINDOW
    assert searched is not None
    assert len(searched.scan) == len(fixes) > 0.95 * scans
    assert searched.begins.sum() == 2
    # Against the recording itself, not against what the drive log says of it.
    np.testing.assert_array_equal(np.asarray(again.fix.code)[searched.scan][own], fixes["code"][own])
    ok = fixes["code"] == Code.OK
    assert ok.sum() > 0.5 * own.sum() > 0.1 * scans / 2
    found = np.asarray(again.fix.pose)[searched.scan]
    assert np.hypot(*(found[ok, :2] - fixes["pose"][ok, :2]).T).max() < 1e-3
    turn = found[ok, 3] - fixes["pose"][ok, 3]
    assert np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi).max() < 1e-3
    told = agreement(searched, again.fix)
    assert (told.fixes, told.same_code) == (int(own.sum()), int(own.sum()))
    assert told.largest_m < 1e-3
    return again


def check_off_board(ground: Site, run: Path, scans: int) -> None:
    """By the drive's own navigation as many scans have a fix that is ok as on board: within a point."""
    rows = [
        record.payload for record in map(unpack, (data for _, data in read_run(run))) if record.kind is RecordKind.FIX
    ]
    codes = np.frombuffer(b"".join(rows), FIX)["code"]
    options = options_of(read_config(run.parent / "CONFIG.toml"))
    with MapFile.open(ground.map) as source, DriveLog.open(ground.logs["live"]) as log:
        offline = np.asarray(register_log(source, log, options).fix.code)[:scans]
    shares = [np.mean(each[each != Code.NO_WINDOW] == Code.OK) for each in (codes, offline)]
    assert abs(shares[0] - shares[1]) <= 0.01
