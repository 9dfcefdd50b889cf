"""What no instrument recorded is named by every importer, by the same names; what one did record is not."""

from collections.abc import Callable
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from formats.mcap_sample import rover_messages, write_recording
from formats.test_grounded import _import as import_run
from formats.test_grounded import _write_run
from lgprjax.formats import (
    DriveLog,
    McapAssumed,
    SurveyOrigin,
    UniformArray,
    assumed_in_words,
    assumed_of,
    export_mcap,
    import_cmu,
    import_gprmax,
    import_iprb,
    import_lines,
    import_mcap,
    import_segy,
)
from lgprjax.formats.profile import Quantity
from vendor_sets import write_cmu, write_gprmax, write_iprb, write_mala_pair, write_segy

HERE, NOWHERE = SurveyOrigin(48.0, 11.0, 30.0), SurveyOrigin(0.0, 0.0, 90.0)
_ARRAY = UniformArray(0.2, 0.5, 0.15)
_SIGMAS = {"position sigma", "heading sigma"}
_STRAIGHT = {"time", "speed", "odometry", "position", "heading", "roll", "height"} | _SIGMAS


def _assumed(path: Path) -> dict[str, str]:
    with DriveLog.open(path) as log:
        return assumed_of(log.description.provenance)


_IMPORTERS: dict[str, tuple[Callable[[Path, SurveyOrigin, Path], object], set[str]]] = {
    "iprb": (lambda folder, place, out: import_iprb(write_iprb(folder), place=place, output=out), _STRAIGHT),
    "segy": (
        lambda folder, place, out: import_segy(write_segy(folder)[0], place=place, output=out),
        _STRAIGHT | {"time zero"},
    ),
    "gprmax": (lambda folder, place, out: import_gprmax(write_gprmax(folder), place=place, output=out), _STRAIGHT),
    "lines": (
        lambda folder, place, out: import_lines(
            write_mala_pair(folder, ".rd7"),
            line_spacing_m=0.5,
            output=out,
            latitude_deg=place.latitude_deg,
            longitude_deg=place.longitude_deg,
            heading_deg=place.heading_deg,
        ),
        _STRAIGHT | {"direction"},
    ),
    # Its clock and its wheel were recorded.
    "cmu": (
        lambda folder, place, out: import_cmu(write_cmu(folder)[0], time_window_ns=8.0, place=place, output=out),
        {"time zero", "position", "heading", "roll", "height"} | _SIGMAS,
    ),
}


@pytest.mark.parametrize("name", _IMPORTERS)
def test_every_importer_names_what_it_made_up(name: str, tmp_path: Path) -> None:
    write, due = _IMPORTERS[name]
    for place, unplaced in ((HERE, set[str]()), (NOWHERE, {"place on the earth"})):
        folder = tmp_path / str(place.latitude_deg)
        folder.mkdir()
        write(folder, place, folder / "a.drive.h5")
        found = _assumed(folder / "a.drive.h5")
        assert set(found) == due | unplaced
        assert set(found) <= set(get_args(Quantity))
        assert all(found.values())


def test_a_run_with_positions_has_a_path_but_no_clock(tmp_path: Path) -> None:
    _write_run(tmp_path, 0.5 * np.arange(6))
    import_run(tmp_path, tmp_path / "run.drive.h5")
    found = _assumed(tmp_path / "run.drive.h5")
    assert set(found) == {"time", "time zero", "odometry", "roll", "height"} | _SIGMAS


def test_a_recording_names_the_sensors_that_it_lacks(tmp_path: Path) -> None:
    write_recording(tmp_path / "whole.mcap", rover_messages())
    import_mcap(tmp_path / "whole.mcap", array=_ARRAY, output=tmp_path / "whole.drive.h5")
    assert _assumed(tmp_path / "whole.drive.h5") == {}
    messages = [each for each in rover_messages() if each[0] not in ("/rover/imu", "/rover/odom")]
    write_recording(tmp_path / "a.mcap", messages)
    told = McapAssumed(heading_sigma_deg=3.0)
    import_mcap(tmp_path / "a.mcap", array=_ARRAY, assumed=told, output=tmp_path / "a.drive.h5")
    found = _assumed(tmp_path / "a.drive.h5")
    assert set(found) == {"odometry", "heading", "roll", "heading sigma"}
    assert "3" in found["heading sigma"]


def test_what_was_assumed_is_not_forgotten_on_the_way_through_a_recording(tmp_path: Path) -> None:
    """The messages of an exported survey look recorded: there and back it is still a survey."""
    import_iprb(write_iprb(tmp_path), place=NOWHERE, output=tmp_path / "a.drive.h5")
    export_mcap(tmp_path / "a.drive.h5", tmp_path / "a.mcap")
    import_mcap(tmp_path / "a.mcap", output=tmp_path / "b.drive.h5")
    assert _assumed(tmp_path / "b.drive.h5") == _assumed(tmp_path / "a.drive.h5")


def test_logs_of_before_and_of_others_say_nothing() -> None:
    assert assumed_of({}) == {}
    assert assumed_of({"assumed": "much"}) == {}
    assert assumed_of({"assumed": {"gnss_m": [0.0, 0.0, 0.0], "gnss_sigma_m": None}}) == {}
    assert assumed_in_words({"time": "unknown", "speed": "1 m/s"}) == "time (unknown), speed (1 m/s)"
