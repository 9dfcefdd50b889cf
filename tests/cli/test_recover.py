"""``lgprjax recover`` as a person meets it after a power cut."""

from pathlib import Path

import pytest

from canon.commands import run, succeed
from canon.site import Site
from lgprjax.formats import DriveLog, check_file
from recordings.run_sample import run_of_drive


@pytest.fixture
def recorded(site: Site, tmp_path: Path) -> Path:
    folder = tmp_path / "run"
    run_of_drive(site, "impostor", folder)
    return folder


def test_a_run_that_was_cut(recorded: Path, tmp_path: Path) -> None:
    output = tmp_path / "saved.drive.h5"
    assert "ended" in succeed("recover", recorded, "-o", output)
    with DriveLog.open(output) as log:
        whole = log.scans
    segment = recorded / "0000.lgprun"
    segment.write_bytes(segment.read_bytes()[: segment.stat().st_size // 2])
    run("recover", recorded, "-o", output).refusal.check("output", "--force", file=output)
    out = succeed("recover", recorded, "-o", output, "--force")
    assert "interrupted" in out
    assert "0000.lgprun at byte" in out
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        assert 0.4 * whole < log.scans < 0.6 * whole
        assert log.description.provenance["recording"]["ended"] is None  # type: ignore[index]


def test_nothing_can_be_saved(recorded: Path, tmp_path: Path, site: Site) -> None:
    output = tmp_path / "saved.drive.h5"
    (tmp_path / "m.map.h5").unlink()
    done = run("recover", recorded, "-o", output)
    assert (done.status, done.refusal.file) == (1, str(tmp_path / "m.map.h5"))
    # Map and vehicle may lie elsewhere.
    succeed("recover", recorded, "-o", output, "--map", site.map)
    output.unlink()
    (recorded / "0000.lgprun").write_bytes((recorded / "0000.lgprun").read_bytes()[:300])
    for folder in (recorded, tmp_path / "none", tmp_path):
        done = run("recover", folder, "-o", output, "--map", site.map)
        assert done.status == 1
        assert done.about.startswith(str(folder))
    assert not output.exists()
    assert list(tmp_path.glob(".*")) == []
