"""Drives: opened from drive logs, or simulated."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from lgprjax.api.inputs import PathLike, path_of, require_slice, told_as_arguments
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, VehicleLog

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_BLOCK_SCANS = 512


@dataclass(frozen=True)
class Drive:
    """A recorded drive. The file is opened for each access and closed again.

    Attributes:
        path: the drive log, ``X.drive.h5``.
        name: name of the drive.
        scans: number of scans; 0 in a log without radar, such as a calibration drive.
        channels: number of channels of the radar array.
        length_m: distance travelled by odometry, forward and reverse, m.
        duration_s: time from the first record to the last, s.
        t0_utc: ISO 8601 origin of the log's ``time_s``.
    """

    path: Path
    name: str
    scans: int
    channels: int
    length_m: float
    duration_s: float
    t0_utc: str

    def __repr__(self) -> str:
        what = f"{self.scans} scans of {self.channels} channels" if self.scans else "no radar"
        return f"Drive {self.name!r}: {what}, {self.length_m:.1f} m, {self.duration_s:.1f} s ({self.path.name})"

    def traces(self, scans: slice = slice(None)) -> Float[np.ndarray, "scan channel recorded"]:
        """Recorded amplitudes with the zero level removed; NaN where a channel has no data.

        For a stepped-frequency radar these are the calibrated sweeps, real parts before imaginary parts.

        Args:
            scans: scans to read; a negative step reads backward.

        Raises:
            InputError: the log has no radar recording or is damaged, or ``scans`` is not a slice.
        """
        from lgprjax.recordings import recording_of

        require_slice(scans)
        with DriveLog.open(self.path) as log:
            wanted = np.arange(log.scans)[scans]
            # Blocks come in the order of the log, whatever that of the slice. Without scans one still gives the shape.
            rising = np.sort(wanted)
            first, last = (int(rising[0]), int(rising[-1])) if len(rising) else (0, 0)
            found = []
            for block in recording_of(log).blocks(_BLOCK_SCANS, first):
                rows = rising[(rising >= block.start) & (rising < block.start + len(block.recorded))] - block.start
                found.append(np.where(block.valid[rows][..., None], block.recorded[rows], np.float32(np.nan)))
                if block.start + len(block.recorded) > last:
                    break
            traces = np.concatenate(found)
            return traces if np.array_equal(wanted, rising) else traces[::-1]

    def plot(self, *, channel: int | None = None, ax: "Axes | None" = None) -> "Axes":
        """Draw the radargram of one channel, by default the middle one, and return the axes. See ``view``."""
        from lgprjax.api.files import view

        return view(self, channel=channel, ax=ax)


def open_drive(path: PathLike) -> Drive:
    """Open a drive log and check everything but the radar data.

    Args:
        path: drive log, ``X.drive.h5``. ``lgprjax import`` converts supported recordings.

    Raises:
        InputError: the file is missing, damaged, or does not match data_schema/drive.toml.

    Example:
        drive = lx.open_drive("drives/live.drive.h5")
        print(drive)                       # Drive 'live': 1540 scans of 11 channels, 55.4 m, ...
        first = drive.traces(slice(0, 10))  # [scan, channel, sample]
    """
    file = path_of(path, "drive")
    try:
        with DriveLog.open(file) as log:
            known = log.description
            return Drive(
                path=file.absolute(),
                name=known.name,
                scans=log.scans,
                channels=log.channels,
                length_m=_travel_m(known.odometry.distance_m),
                duration_s=float(log.scan_time_s[-1] - log.scan_time_s[0]),
                t0_utc=known.t0_utc,
            )
    except InputError as error:
        if error.place != "/radar" or "without radar" not in error.found:
            raise
    signals = VehicleLog.open(file)
    time_s = signals.odometry.time_s
    return Drive(
        path=file.absolute(),
        name=signals.name,
        scans=0,
        channels=0,
        length_m=_travel_m(signals.odometry.distance_m),
        duration_s=float(time_s[-1] - time_s[0]),
        t0_utc=signals.t0_utc,
    )


def simulate(
    site: PathLike, folder: PathLike, *, only: str | Iterable[str] = (), force: bool = False
) -> dict[str, Drive]:
    """Generate the drives of a site: synthetic ground with stones and layers, recorded by a radar array.

    The log stores the true pose of every scan. The same site gives the same drives.

    Args:
        site: site file (docs/scene.md lists its keys), file of calibration drives such as tuning/drives.toml, or name
            of an example site. ``"village"`` is a road of 70 m with two baselines with survey-grade positions
            (``baseline_left``, ``baseline_right``), a drive on another day with a GNSS error of 1 m (``live``), and the
            same drive over other ground, of which no scan may be located (``impostor``).
        folder: folder for ``NAME.drive.h5`` of each drive; created if missing.
        only: name or names of the drives to generate; default: all.
        force: replace existing files.

    Returns:
        The drives by name.

    Raises:
        InputError: the site cannot be read or driven, a name in ``only`` is unknown, or an output exists.

    Example:
        drives = lx.simulate("village", "generated/", only=["impostor"], force=True)
        print(drives["impostor"].length_m)
    """
    from lgprjax.simulation import (
        is_vehicle_plan,
        plan_site,
        read_site,
        read_vehicle_plan,
        site_file,
        write_site,
        write_vehicle_logs,
    )

    target, wanted = path_of(folder, "folder"), (only,) if isinstance(only, str) else tuple(only)
    with told_as_arguments():
        file = site_file(path_of(site, "site"))
        if is_vehicle_plan(file):
            paths = write_vehicle_logs(read_vehicle_plan(file), target, only=wanted, force=force)
        else:
            paths = write_site(plan_site(read_site(file), file, wanted), target, force=force)
    return {name: open_drive(path) for name, path in paths.items()}


def _travel_m(distance_m: Float[np.ndarray, " time"]) -> float:
    return float(np.sum(np.abs(np.diff(distance_m))))
