"""The pictures of one registered drive: its trajectory, its confidence, and one fix looked at closely."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from lgprjax.batch import FixExample, RegisteredDrive
    from lgprjax.formats import DriveLog, MapFile
    from lgprjax.frames import LocalFrame
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import CorrelationSurface, DriveResult, MatchExample, ReportFigure, SwarmPicture


ENDS = ("-trajectory.png", "-confidence.png", "-match.png", "-map.png", "-swarm.png")
"""What a drive's name is followed by; not every drive has them all."""


def draw_drive(
    result: "DriveResult",
    drive: "RegisteredDrive",
    source: "MapFile",
    log: "DriveLog",
    options: "RegisterOptions",
    folder: Path,
    force: bool,
) -> list["ReportFigure"]:
    """Write a drive's pictures to a folder; returns those that there are.

    The confidence is drawn where the truth is known, match and map where a scan was tried, the swarm where one is.

    Raises:
        InputError: one of them exists (without ``force``) or cannot be written.
    """
    from lgprjax.batch import example_scan, fix_example
    from lgprjax.report import (
        ReportFigure,
        draw_confidence,
        draw_match,
        draw_surface,
        draw_swarm,
        draw_trajectory,
        stated_errors,
    )

    trajectory, confidence, match, surface, swarm = (folder / f"{drive.name}{end}" for end in ENDS)
    draw_trajectory(result, trajectory, force=force)
    figures = [ReportFigure(trajectory, "Trajectory and errors along the drive.", "plan view above error curves")]
    stated = stated_errors([result])
    if len(stated.ok):
        draw_confidence(stated, confidence, force=force)
        figures.append(
            ReportFigure(
                confidence,
                "Whether the fixes are as good as they say, and what a smaller risk would cost.",
                "true error over stated sigma, error distributions by evidence, share declined over evidence",
            )
        )
    scan = example_scan(drive)
    example = None if scan is None else fix_example(source, log, drive, options, scan)
    if example is None:
        return figures
    draw_match(_match(example, drive), match, force=force)
    search_m = options.search_half_m(drive.track.sigma_m)
    draw_surface(_surface(example, source.description.frame, search_m), surface, force=force)
    code = drive.table["code"].iloc[example.scan]
    figures.append(
        ReportFigure(match, f"Scan {example.scan}, {code}: the ground live and in the map.", "radargram strips")
    )
    figures.append(
        ReportFigure(surface, f"Scan {example.scan}, {code}: match over the search region.", "correlation map")
    )
    searched = _swarm(example, drive, source.description.frame)
    if searched is not None:
        draw_swarm(searched, swarm, force=force)
        figures.append(
            ReportFigure(
                swarm,
                f"Scan {example.scan}, {code}: the swarm about its best place, run again.",
                "clouds of particles over the score, score over the iterations",
            )
        )
    return figures


def _match(example: "FixExample", drive: "RegisteredDrive") -> "MatchExample":
    from lgprjax.report import MatchExample

    strips, row = example.strips, drive.table.iloc[example.scan]
    distance = strips.distance_m - drive.track.travel_m[0]
    # Of a single scan the box is as wide as a trace.
    window_m = float(np.nan_to_num(np.asarray(drive.fix.window_m)[example.scan]))
    first = distance[-1] - (window_m or distance[-1] - distance[-2])
    return MatchExample(
        baseline=strips.baseline,
        live=strips.live,
        beside=strips.beside,
        beside_m=strips.beside_m,
        distance_m=distance,
        time_ns=strips.time_ns,
        channel=strips.channel,
        correlation=float(row["correlation"]),
        margin=float(row["margin"]),
        gain="depth gain of the map, limited to 2.5 RMS of the scan",
        lag_m=strips.lag_m,
        window_m=(float(first), float(distance[-1])),
    )


def _surface(example: "FixExample", frame: "LocalFrame", search_m: float) -> "CorrelationSurface":
    from lgprjax.report import CorrelationSurface

    prior, best = _pair(example.prior_m), _pair(example.best_m)
    assert prior is not None
    assert best is not None
    return CorrelationSurface(
        x_m=example.surface.along_m,
        y_m=example.surface.cross_m,
        correlation=example.surface.strength,
        half_width_m=(search_m, search_m),
        prior=prior,
        prior_sigma_m=example.prior_sigma_m,
        # The prior's sigmas lie east and north.
        prior_tilt_rad=-float(example.frame[2]),
        best=best,
        second=_pair(example.second_m),
        truth=_pair(example.truth_m),
        origin=_origin(example, frame),
        axes=("along", "cross"),
    )


def _swarm(example: "FixExample", drive: "RegisteredDrive", frame: "LocalFrame") -> "SwarmPicture | None":
    from lgprjax.registration import OFF_MAP_SCORE
    from lgprjax.report import SwarmPicture

    if example.swarm is None:
        return None
    place, best, met, along, cross, score = (np.asarray(field, np.float64) for field in example.swarm)
    return SwarmPicture(
        x_m=along,
        y_m=cross,
        # Off the map a score is less than any correlation.
        score=np.where(score > 0.75 * OFF_MAP_SCORE, score, np.nan),
        particle_m=place,
        best_m=best,
        best_score=np.where(met > 0.75 * OFF_MAP_SCORE, met, -np.inf),
        milliseconds=drive.milliseconds_per_scan,
        origin=_origin(example, frame),
        truth=_pair(example.truth_m),
    )


def _origin(example: "FixExample", frame: "LocalFrame") -> str:
    # Adding 0 takes the sign off a rounded nothing.
    east, north = np.round(example.frame[:2], 1) + 0.0
    bearing = np.degrees(np.pi / 2.0 - example.frame[2]) % 360.0
    return (
        f"a place of the route, east {east:.1f} m and north {north:.1f} m about latitude, longitude "
        f"{frame.latitude_deg:.6f}°, {frame.longitude_deg:.6f}°; along is towards {bearing:.0f}°"
    )


def _pair(place: "np.ndarray | None") -> tuple[float, float] | None:
    return None if place is None else (float(place[0]), float(place[1]))
