"""``lgprjax recover`` as a person meets it after a power cut."""

from collections.abc import Callable
from pathlib import Path

import pytest

from batch.run_sample import run_of_drive
from canon.site import Site
from lgprjax.cli.data import Recover
from lgprjax.cli.terminal import run_verb
from lgprjax.formats import DriveLog, check_file


@pytest.fixture
def run(site: Site, tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    run_of_drive(site, "impostor", folder)
    return folder


def _told(capsys: pytest.CaptureFixture[str], verb: Callable[[], int | None]) -> tuple[int, str, str]:
    status = run_verb(verb)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_a_run_that_was_cut(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "saved.drive.h5"
    status, out, _ = _told(capsys, Recover(run, output).run)
    assert status == 0
    assert "ended" in out
    assert "yes" in out
    with DriveLog.open(output) as log:
        whole = log.scans
    segment = run / "0000.lgprun"
    data = segment.read_bytes()
    segment.write_bytes(data[: len(data) // 2])
    status, _, err = _told(capsys, Recover(run, output).run)
    assert (status, err.count("\n")) == (1, 1)
    assert "one that exists" in err
    status, out, _ = _told(capsys, Recover(run, output, force=True).run)
    assert status == 0
    assert "interrupted" in out
    assert "0000.lgprun at byte" in out
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        assert 0.4 * whole < log.scans < 0.6 * whole
        assert log.description.provenance["recording"]["ended"] is None  # type: ignore[index]


def test_nothing_can_be_saved(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "saved.drive.h5"
    (run / "0000.lgprun").write_bytes((run / "0000.lgprun").read_bytes()[:300])
    for folder in (run, tmp_path / "none", tmp_path):
        status, _, err = _told(capsys, Recover(folder, output).run)
        assert (status, err.count("\n")) == (1, 1)
        assert err.startswith(f"lgprjax: {folder}: ")
    assert not output.exists()
    assert list(tmp_path.glob(".*")) == []


def test_map_and_vehicle_that_lie_elsewhere(
    site: Site, run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m.map.h5").unlink()
    output = tmp_path / "saved.drive.h5"
    status, _, err = _told(capsys, Recover(run, output).run)
    assert status == 1
    assert "m.map.h5" in err
    assert _told(capsys, Recover(run, output, map=site.map).run)[0] == 0
