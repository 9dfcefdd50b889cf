"""Diagrams of boxes and arrows: the system, its data, its processes, and the decisions of a search."""

from itertools import pairwise
from pathlib import Path

from pictures.style import (
    BLUE,
    GREEN,
    MUTED,
    ORANGE,
    SKY,
    SMALL,
    VERMILLION,
    arrow,
    box,
    diagram,
    label,
)

_TITLE = 20.0


def draw_system(path: Path) -> None:
    """Draw the system's parts and what they exchange."""
    with diagram(path, 95.0) as axes:
        stored = box(axes, (16, 85), (30, 15), "Map", "ground,\nroutes", colour=ORANGE, title_size=_TITLE)
        radar = box(axes, (50, 85), (32, 15), "Radar array", "under the\nvehicle", colour=SKY, title_size=_TITLE)
        gnss = box(axes, (84, 85), (30, 15), "GNSS/INS", "and wheel\nspeed", colour=SKY, title_size=_TITLE)
        search = box(axes, (32, 55), (40, 13), "Registration", "matches scans", title_size=_TITLE)
        filtered = box(axes, (82, 55), (34, 13), "Navigation", "Kalman filter", title_size=_TITLE)
        pilot = box(axes, (82, 30), (34, 13), "Autopilot", "path, speed", title_size=_TITLE)
        vehicle = box(axes, (82, 7.5), (34, 12), "Vehicle", "steer, throttle", colour=GREEN, title_size=_TITLE)
        recorder = box(axes, (32, 13), (40, 17), "Recorder", "drive logs;\nnew maps", colour=MUTED, title_size=_TITLE)
        arrow(axes, [(21, stored.bottom[1]), (21, search.top[1])], "map tiles", at=(21, 69.5))
        arrow(axes, [(46, radar.bottom[1]), (46, search.top[1])], "scans", at=(46, 69.5))
        arrow(axes, [(84, gnss.bottom[1]), (84, filtered.top[1])], "position, motion", at=(82, 69.5))
        arrow(axes, [(52, 57.5), (65, 57.5)])
        label(axes, (58.3, 60.4), "fixes")
        arrow(axes, [(65, 52.5), (52, 52.5)])
        label(axes, (58.3, 49.6), "prior")
        arrow(axes, [filtered.bottom, pilot.top], "pose", at=(82, 42.7))
        arrow(axes, [pilot.bottom, vehicle.top], "commands", at=(82, 18.7))
        arrow(axes, [search.bottom, recorder.top], dashed=True, colour=MUTED)
        arrow(axes, [(65, 30), (44, 30), (44, recorder.top[1])], dashed=True, colour=MUTED)
        label(axes, (50.5, 33), "all data", background=True)
        arrow(axes, [(12, 13), (5, 13), (5, stored.bottom[1])], colour=ORANGE)
        label(axes, (5, 45), "new map", background=True, angle=90.0)


def draw_pipeline(path: Path) -> None:
    """Draw the steps from a scan to a fix."""
    steps = (
        ("Scan", "one sweep of every antenna", SKY, 12.5),
        ("Features", "calibrate, remove background,\nscale travel time", BLUE, 16.5),
        ("Coarse search", "correlation at every place of the\nregion, or particle swarm", BLUE, 16.5),
        ("Refinement", "position, height, heading, roll", BLUE, 12.5),
        ("Evidence", "probability p_false that other\nground matches as well", BLUE, 16.5),
        ("Code", "ok: p_false is below the risk", GREEN, 12.5),
    )
    gap = 6.0
    total = sum(height for *_, height in steps) + gap * (len(steps) - 1)
    with diagram(path, total + 3.0) as axes:
        top, made = total + 1.5, []
        for title, text, colour, height in steps:
            made.append(box(axes, (42.5, top - 0.5 * height), (66, height), title, text, colour=colour))
            top -= height + gap
        for before, after in pairwise(made):
            arrow(axes, [before.bottom, after.top])
        _, features, coarse, _, judged, _ = made
        stored = box(axes, (90.5, coarse.y), (17, 16.5), "Map", "tiles near\nthe prior", colour=ORANGE)
        arrow(axes, [stored.left, coarse.right])
        arrow(axes, [judged.left, (4, judged.y), (4, features.y), features.left], dashed=True, colour=MUTED)
        middle = 0.5 * (judged.y + features.y)
        label(axes, (4, middle), "weak: longer window", background=True, angle=90.0)


def draw_data_flow(path: Path) -> None:
    """Draw the files that commands read and write."""
    with diagram(path, 118.0) as axes:
        given = box(axes, (26, 109), (48, 14), "Recordings", "radar files, ROS bags", colour=MUTED)
        simulated = box(axes, (79, 109), (38, 14), "Site file", "simulated site", colour=MUTED)
        drive = box(axes, (50, 82), (60, 14), "Drive log", "*.drive.h5", colour=SKY)
        stored = box(axes, (26, 55), (46, 14), "Map", "*.map.h5", colour=ORANGE)
        fixes = box(axes, (50, 28), (88, 14), "Fixes", "*.fixes.csv, *.fixes.h5, report.html", colour=GREEN)
        exported = box(axes, (50, 6.5), (88, 12), "trajectory, GIS layers, MCAP", colour=MUTED, title_size=SMALL)
        arrow(axes, [(26, given.bottom[1]), (26, drive.top[1])], "import", at=(26, 96))
        arrow(axes, [(74, simulated.bottom[1]), (74, drive.top[1])], "simulate", at=(74, 96))
        arrow(axes, [(26, drive.bottom[1]), stored.top], "map build", at=(26, 69))
        arrow(axes, [(26, stored.bottom[1]), (26, fixes.top[1])], "register", at=(26, 42))
        arrow(axes, [(74, drive.bottom[1]), (74, fixes.top[1])], "register", at=(74, 42))
        label(axes, (74, 58.5), "live drive", background=True)
        arrow(axes, [fixes.bottom, exported.top], "export", at=(50, 16.8))


def draw_fix_codes(path: Path) -> None:
    """Draw the decisions that lead to a code, in the order in which the search takes them."""
    questions = (
        ("Window of scans complete?", "no_window"),
        ("Data finite?", "non_finite"),
        ("Place on the map?", "off_map"),
        ("Enough overlap with the map?", "low_overlap"),
        ("p_false below the risk?", "low_correlation"),
        ("Inside the search region?", "edge"),
        ("Better than the runner-up?", "ambiguous"),
    )
    step, height, width = 14.0, 8.6, 57.0
    total = step * (len(questions) + 1)
    with diagram(path, total) as axes:
        past = None
        for number, (question, code) in enumerate(questions):
            y = total - step * (number + 0.5)
            asked = box(axes, (30, y), (width, height), question, title_size=SMALL - 1.0)
            refused = box(axes, (83.5, y), (32, height), code, colour=VERMILLION, title_size=SMALL - 0.5)
            arrow(axes, [asked.right, refused.left])
            label(axes, (62.6, y + 2.6), "no")
            if past is not None:
                arrow(axes, [past.bottom, asked.top])
                label(axes, (34.5, y + 0.5 * step), "yes")
            past = asked
        assert past is not None
        good = box(axes, (30, 0.5 * step), (width, height), "ok: a position", colour=GREEN)
        arrow(axes, [past.bottom, good.top])
        label(axes, (34.5, step), "yes")
        label(axes, (83.5, 0.5 * step + 2.2), "rejected: no")
        label(axes, (83.5, 0.5 * step - 2.2), "position")


def draw_modes(path: Path) -> None:
    """Draw the operating modes and what changes them."""
    with diagram(path, 116.0) as axes:
        size = (34, 9)
        boot = box(axes, (19, 109), size, "BOOT", colour=MUTED, title_size=_TITLE)
        checks = box(axes, (19, 89), size, "CHECKS", colour=MUTED, title_size=_TITLE)
        ready = box(axes, (19, 69), size, "READY", title_size=_TITLE)
        steering = box(axes, (19, 43), size, "STEERING", colour=GREEN, title_size=_TITLE)
        speed = box(axes, (19, 17), size, "SPEED", colour=GREEN, title_size=_TITLE)
        manual = box(axes, (76, 43), size, "MANUAL", colour=ORANGE, title_size=_TITLE)
        error = box(axes, (76, 83), size, "ERROR", colour=VERMILLION, title_size=_TITLE)
        stop = box(axes, (73.5, 109), (47, 9), "EMERGENCY_STOP", colour=VERMILLION, title_size=SMALL)
        arrow(axes, [boot.bottom, checks.top], "boot done", at=(19, 99.4))
        arrow(axes, [checks.bottom, ready.top], "checks passed", at=(19, 79.4))
        arrow(axes, [ready.bottom, steering.top])
        label(axes, (19, 58.3), "steering button,", background=True)
        label(axes, (19, 54.2), "near the route", background=True)
        arrow(axes, [(9, steering.bottom[1]), (9, speed.top[1])])
        label(axes, (10.5, 32), "cruise", align="left")
        label(axes, (10.5, 28), "button", align="left")
        arrow(axes, [(29, speed.top[1]), (29, steering.bottom[1])])
        label(axes, (30.5, 32), "brake", align="left")
        label(axes, (30.5, 28), "tapped", align="left")
        arrow(axes, [steering.right, manual.left], colour=ORANGE)
        arrow(axes, [speed.right, (76, 17), manual.bottom], colour=ORANGE)
        label(axes, (76, 31.5), "override, torque,", background=True)
        label(axes, (76, 27.4), "brake held, off route,", background=True)
        label(axes, (76, 23.3), "health: stop", background=True)
        arrow(axes, [(72, manual.top[1]), (72, 66.5), (36, 66.5)])
        label(axes, (61, 58.3), "override", background=True)
        label(axes, (61, 54.2), "released", background=True)
        arrow(axes, [error.left, (47, error.y), (47, 71.5), (36, 71.5)])
        label(axes, (69, 75.3), "cleared,", background=True)
        label(axes, (69, 71.2), "override pressed", background=True)
        arrow(axes, [(97, stop.bottom[1]), (97, 43), manual.right])
        label(axes, (97, 62), "override pressed", background=True, angle=90.0)
        arrow(axes, [(53, 91.5), (61, error.top[1])], colour=VERMILLION)
        label(axes, (52, 94.5), "any mode: error")
        arrow(axes, [(52, 97.5), (58, stop.bottom[1])], colour=VERMILLION)
        label(axes, (76, 99.3), "any mode: button")
        label(axes, (50, 4.0), "BOOT, CHECKS, READY: override also leads to MANUAL")


def draw_onboard_processes(path: Path) -> None:
    """Draw the processes of the onboard runtime and the data that they exchange."""
    with diagram(path, 94.0) as axes:
        radar = box(axes, (17, 85), (30, 13), "Radar", colour=SKY, title_size=_TITLE)
        gnss = box(axes, (51, 85), (30, 13), "GNSS/INS", colour=SKY, title_size=_TITLE)
        vehicle = box(axes, (85, 85), (28, 13), "Drive-\nby-wire", colour=SKY, title_size=_TITLE)
        search = box(axes, (21, 58), (38, 13), "registration", "scans to fixes", title_size=_TITLE)
        control = box(axes, (74, 58), (48, 13), "control", "pose, commands", title_size=_TITLE)
        recorder = box(axes, (17, 32), (30, 13), "recorder", "all data", colour=MUTED, title_size=_TITLE)
        display = box(axes, (51, 32), (30, 13), "display", "web page", colour=MUTED, title_size=_TITLE)
        monitor = box(axes, (85, 32), (28, 13), "monitor", "disk, heat", colour=MUTED, title_size=_TITLE)
        box(
            axes, (50, 8), (97, 13), "supervisor", "starts, watches and relaunches the processes", colour=ORANGE,
            title_size=_TITLE,
        )  # fmt: skip
        arrow(axes, [(17, radar.bottom[1]), (17, search.top[1])], "scans", at=(17, 71.5))
        arrow(axes, [(55, gnss.bottom[1]), (55, control.top[1])], "position", at=(52, 71.5))
        arrow(axes, [(80, vehicle.bottom[1]), (80, control.top[1])])
        arrow(axes, [(90, control.top[1]), (90, vehicle.bottom[1])])
        label(axes, (85, 71.5), "state, commands", background=True)
        arrow(axes, [search.right, control.left])
        label(axes, (45, 61.6), "fixes")
        arrow(axes, [(10, search.bottom[1]), (10, recorder.top[1])], dashed=True, colour=MUTED)
        arrow(axes, [(60, control.bottom[1]), (60, 45.0), (24, 45.0), (24, recorder.top[1])], dashed=True, colour=MUTED)
        arrow(axes, [(60, 45.0), (60, display.top[1])], dashed=True, colour=MUTED)
        label(axes, (42, 47.8), "state, fixes")
        arrow(axes, [monitor.top, (85, control.bottom[1])], dashed=True, colour=MUTED)
        label(axes, (85, 45.0), "load", background=True)
        for x in (17, 51, 85):
            arrow(axes, [(x, 14.5), (x, 25.5)], colour=ORANGE)
