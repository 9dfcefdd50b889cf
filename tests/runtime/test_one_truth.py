"""One truth on board and off: the fixes of a recorded run are those of its drive log, registered again."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from batch.run_sample import MONO_NS, run_of_drive
from canon.map import of_many_grounds
from canon.site import Site
from formats.run_log_sample import head_bytes, own_bytes, record_bytes
from lgprjax.batch import agreement, on_board_of, options_as_provenance, register_log, write_run_drive
from lgprjax.cli import main
from lgprjax.formats import DriveLog, MapFile, check_file, read_run, read_vehicle
from lgprjax.mapping import build_map
from lgprjax.registration import Code
from lgprjax.run_records import FIX, Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.registration.program import ScanQueue, array_place
from lgprjax.runtime.registration.scans import SCAN_MESSAGES, RadarSelf
from lgprjax.runtime.registration.search import Search, options_of
from lgprjax.runtime.stamps import StampClock
from lgprjax.simulation import plan_drive, prepare_site, read_site, write_drive
from lgprjax.wire import decode

ROOT = Path(__file__).resolve().parents[2]
_SCANS = 500
_RESTART = 330
"""Scans until the registration process is started anew."""


def _searched(
    records: list[Record], config: RuntimeConfig, source: MapFile, rng: np.random.Generator
) -> Iterator[Record]:
    """The records of a run, and those of its registration, which gets to it whenever a busy computer lets it."""
    vehicle = read_vehicle(config.path(config.vehicle))
    said, clock, queue, scans = RadarSelf(), StampClock(), None, 0
    for record in records:
        yield record
        if record.kind is RecordKind.PRIOR and queue is not None:
            queue.priors.take(record.payload)
        elif record.kind is RecordKind.PORT_IN and record.source is Source.RADAR:
            frame = decode(record.payload)
            if frame.name in SCAN_MESSAGES and scans < _SCANS:
                if scans in (0, _RESTART):
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


@pytest.fixture(scope="module", params=["traces", pytest.param("sweeps", marks=pytest.mark.campaign)])
def ground(request: pytest.FixtureRequest, site: Site, tmp_path_factory: pytest.TempPathFactory) -> Site:
    """The site, or that of a stepped-frequency radar whose gain drifts by 20 % within each drive."""
    if request.param == "traces":
        return site
    folder = tmp_path_factory.mktemp("swept")
    scene = prepare_site(read_site(ROOT / "sites" / "array_sweeps.toml"))
    logs = {drive.name: folder / f"{drive.name}.drive.h5" for drive in scene.site.drives if drive.other_ground is None}
    for drive in scene.site.drives:
        if drive.name in logs:
            write_drive(logs[drive.name], plan_drive(scene, drive), sweeps=scene.site.sweeps)
    database = folder / "swept.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], database, measure=of_many_grounds)
    return Site(folder, logs, database)


@pytest.fixture(scope="module")
def run(ground: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose registration has searched its first scans."""
    folder = tmp_path_factory.mktemp("run") / "recorded"
    run_of_drive(ground, "live", folder)
    config = read_config(folder.parent / "CONFIG.toml")
    records = [unpack(data) for _, data in read_run(folder)]
    parts = [head_bytes(0, 0, mono_ns=MONO_NS)]
    with MapFile.open(ground.map) as source:
        for number, record in enumerate(_searched(records, config, source, np.random.default_rng(5))):
            parts.append(record_bytes(number, pack(record)))
    parts.append(own_bytes(len(parts) - 1, end="ended"))
    (folder / "0000.lgprun").write_bytes(b"".join(parts))
    return folder


def test_the_fixes_of_a_run_are_those_of_its_drive_log(ground: Site, run: Path, tmp_path: Path) -> None:
    config, path = read_config(run.parent / "CONFIG.toml"), tmp_path / "run.drive.h5"
    options = options_of(config)
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
    assert len(searched.scan) == len(fixes) > 0.95 * _SCANS
    assert searched.begins.sum() == 2
    # Against the recording itself, not against what the drive log says of it.
    np.testing.assert_array_equal(np.asarray(again.fix.code)[searched.scan][own], fixes["code"][own])
    ok = fixes["code"] == Code.OK
    assert ok.sum() > 0.5 * own.sum() > 50
    found = np.asarray(again.fix.pose)[searched.scan]
    assert np.hypot(*(found[ok, :2] - fixes["pose"][ok, :2]).T).max() < 1e-3
    turn = found[ok, 3] - fixes["pose"][ok, 3]
    assert np.abs((turn + np.pi) % (2.0 * np.pi) - np.pi).max() < 1e-3
    told = agreement(searched, again.fix)
    assert (told.fixes, told.same_code) == (int(own.sum()), int(own.sum()))
    assert told.largest_m < 1e-3
    # The command finds the options that the run was searched with by itself.
    # Off board, by the log's own navigation, as many scans have a fix that is ok: within a point.
    with MapFile.open(ground.map) as source, DriveLog.open(ground.logs["live"]) as log:
        offline = np.asarray(register_log(source, log, options).fix.code)[:_SCANS]
    own_offline = offline != Code.NO_WINDOW
    assert abs(ok.sum() / own.sum() - np.mean(offline[own_offline] == Code.OK)) <= 0.01
    with pytest.raises(SystemExit) as ended:
        main(["register", str(ground.map), str(path), "-o", str(tmp_path / "again"), "--track"])
    assert ended.value.code == 0
    table = pd.read_csv(tmp_path / "again" / "run.fixes.csv")
    assert list(table["code"]) == list(again.table["code"])
