"""Files of the package and of instruments: validation and display."""

from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from lgprjax.api.inputs import PathLike, axes_or_new, path_of, require_number, told_as_arguments, whole_number
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, Finding, VehicleLog, check_file

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from lgprjax.recordings import DriveHealth
    from lgprjax.report import LineView


@dataclass(frozen=True, eq=False)
class Checked:
    """Result of checking a file.

    Attributes:
        path: path of the file.
        findings: schema violations, with file, place, expected, found and severity.
        health: recording quality of a drive log; None if not requested.
    """

    path: Path
    findings: tuple[Finding, ...]
    health: "DriveHealth | None" = None

    @property
    def ok(self) -> bool:
        """Whether the file is usable, without a finding of severity ``error``."""
        return not any(finding.severity == "error" for finding in self.findings)

    @cached_property
    def table(self) -> "pd.DataFrame":
        """DataFrame of the findings, or with ``health`` of the quality figures with limits and verdicts."""
        import pandas as pd

        if self.health is None:
            columns = [field.name for field in fields(Finding)]
            return pd.DataFrame([vars(finding) for finding in self.findings], columns=columns)
        return pd.DataFrame([figure._asdict() for figure in self.health.figures]).drop(columns="where")

    def __repr__(self) -> str:
        verdict = "ok" if self.ok else "cannot be used"
        health = "" if self.health is None else f", recording {self.health.verdict}"
        return "\n".join([f"Checked {self.path.name}: {verdict}{health}", *(f"  {each}" for each in self.findings)])


def check(file: PathLike, *, health: bool = False) -> Checked:
    """Validate a file against its schema; list every violation.

    Args:
        file: drive log, map, fixes, route, vehicle file, coverage plan or record of the area worked, or an object
            opened from one.
        health: also measure the recording quality of a drive log: radar, clock, odometry, GNSS; without radar only the
            last two.

    Raises:
        InputError: the file's format is unknown, or ``health`` was requested for a file that is not a drive log.

    Example:
        checked = lx.check("drives/live.drive.h5", health=True)
        print(checked)                     # Checked live.drive.h5: ok, recording good
        print(checked.table[["name", "value", "unit", "verdict"]])
    """
    path = path_of(file, "file")
    if health and not path.name.lower().endswith(".drive.h5"):
        raise InputError(path, "health", "a drive log, X.drive.h5", repr(path.name))
    checked = Checked(path.absolute(), tuple(check_file(path)))
    if not (health and checked.ok):
        return checked
    from lgprjax.recordings import drive_health, has_radar, vehicle_health

    if not has_radar(path):
        return Checked(checked.path, checked.findings, vehicle_health(VehicleLog.open(path)))
    with DriveLog.open(path) as log:
        return Checked(checked.path, checked.findings, drive_health(log))


def view(
    file: PathLike,
    *,
    channel: int | None = None,
    raw: bool = False,
    velocity_m_per_ns: float | None = None,
    travel_time_ns: float | None = None,
    ax: "Axes | None" = None,
) -> "Axes":
    """Draw a recording as a radargram, or a map as a time slice, and return the axes.

    A radargram shows travel time and depth downward over distance, dewowed, background removed, with a depth gain. A
    time slice shows the RMS amplitude of the map from above.

    Args:
        file: vendor file (.dt1, .dzt, .rd3, .rd7, .iprb, .sgy), drive log or map, or an open drive or map.
        channel: channel of a recording, from 0; default: the middle one.
        raw: amplitudes as recorded, without processing or gain.
        velocity_m_per_ns: wave velocity for the depth axis, m/ns; default: 0.1.
        travel_time_ns: two-way travel time of the middle of the time slice, ns; default: the second of five slices from
            the top.
        ax: axes to draw on; default: axes of a new figure.

    Raises:
        InputError: the file cannot be read, has no such channel, the velocity is out of range, or the map has no data
            at that travel time.

    Example:
        ax = lx.view("drives/live.drive.h5", channel=5)
        ax.figure.savefig("live.png")
        lx.view("site.map.h5")
    """
    from lgprjax.radar import WAVE_SPEED_M_PER_NS
    from lgprjax.report import draw_radargram
    from lgprjax.report.views import MAP, check_speed

    path = path_of(file, "file")
    if travel_time_ns is not None:
        require_number("travel_time_ns", travel_time_ns, "a number", -np.inf, np.inf)
    if path.name.lower().endswith(MAP):
        if velocity_m_per_ns is not None:
            require_number("velocity_m_per_ns", velocity_m_per_ns, "a number", -np.inf, np.inf)
        with told_as_arguments():
            check_speed(velocity_m_per_ns)
            if raw or channel is not None:
                raise InputError(path, "raw, channel", "a recording (a map has no such options)", "a map")
            speed = WAVE_SPEED_M_PER_NS if velocity_m_per_ns is None else velocity_m_per_ns
            return _draw_slice(path, travel_time_ns, speed, axes_or_new(ax))
    if travel_time_ns is not None:
        with told_as_arguments():
            raise InputError(path, "travel_time_ns", "a map (only its time slices have a travel time)", repr(path.name))
    line = line_view(path, channel, raw=raw, velocity_m_per_ns=velocity_m_per_ns)
    middle = len(line.radargrams) // 2
    radargram = line.radargrams[middle]
    axes = draw_radargram(radargram, axes_or_new(ax), wave_speed_m_per_ns=line.wave_speed_m_per_ns)
    # Of several channels only one is drawn, and its title may not name it.
    shown = f"; channel {middle} of 0 to {len(line.radargrams) - 1}" if len(line.radargrams) > 1 else ""
    axes.set_title(line.title + shown)
    return axes


def line_view(path: Path, channel: int | None, *, raw: bool, velocity_m_per_ns: float | None) -> "LineView":
    """The radargram of a recording, for ``view`` and ``zoom``; ``channel`` ``None``: a drive log's middle channel.

    Raises:
        InputError: as for ``view``.
    """
    from lgprjax.report.views import DRIVE, MAP, check_speed, view_of_drive, view_of_profile

    channel = None if channel is None else whole_number("channel", channel)
    if velocity_m_per_ns is not None:
        require_number("velocity_m_per_ns", velocity_m_per_ns, "a number", -np.inf, np.inf)
    with told_as_arguments():
        check_speed(velocity_m_per_ns)
        name = path.name.lower()
        if name.endswith(MAP):
            raise InputError(path, "file", "a recording", "a map (use view() for a time slice)")
        if name.endswith(DRIVE):
            if channel is None:
                with DriveLog.open(path) as log:
                    channel = log.channels // 2
            return view_of_drive(path, channel=channel, raw=raw, speed_m_per_ns=velocity_m_per_ns)
        return view_of_profile(
            path, channel=channel, raw=raw, speed_m_per_ns=velocity_m_per_ns, sample_interval_ns=None
        )


def _draw_slice(path: Path, travel_time_ns: float | None, speed_m_per_ns: float, axes: "Axes") -> "Axes":
    from lgprjax.report import slice_map
    from lgprjax.report.radargram import level_limits, slice_title
    from lgprjax.report.style import CORRELATION_MAP, outer_edges
    from lgprjax.report.views import stations_of_map

    stations = stations_of_map(path, travel_time_ns)
    slices = slice_map(stations)
    number = 1 if travel_time_ns is None else 0
    low, high = level_limits(slices.level)
    image = axes.imshow(
        slices.level[number],
        cmap=CORRELATION_MAP,
        vmin=low,
        vmax=high,
        origin="lower",
        aspect="equal" if slices.equal else "auto",
        interpolation="nearest",
        extent=(*outer_edges(slices.x_m), *outer_edges(slices.y_m)),
    )
    axes.set_xlabel(slices.labels[0])
    axes.set_ylabel(slices.labels[1])
    axes.set_title(f"Map {stations.name}: {slice_title(stations, number, speed_m_per_ns)}")
    axes.figure.colorbar(image, ax=axes, label="RMS amplitude")
    return axes
