"""Several vehicles in one picture: steering curves over one another (LL figs. 17 and 19), and numbers side by side."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.formats import VehicleFile
from lgprjax.report.style import BLUE, FAINT, GREEN, INK, MUTED, ORANGE, PURPLE, SKY, VERMILLION, picture, write_caption
from lgprjax.tuning.studies.fleet import Fleet

_COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, INK)
_MARKERS = "osD^vPX"
_ROW_IN = 0.26
_BEYOND = 50.0
"""Per cent beyond which a deviation is drawn at the rim."""


def draw_fleet_curves(fleet: Fleet, path: str | Path, *, force: bool = False) -> None:
    """Draw wheel angle and encoder over the potentiometer of each vehicle, counted from its straight position.

    Vehicles without the numbers of a curve are left out of it.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 10.0, 4.8, force) as figure:
        left, right = figure.subplots(1, 2)
        for place, (name, vehicle) in enumerate(zip(fleet.names, fleet.vehicles, strict=True)):
            look = {"color": _COLOURS[place % len(_COLOURS)], "linewidth": 1.4, "label": name}
            look |= {"marker": _MARKERS[place % len(_MARKERS)], "markersize": 3.5, "markevery": 0.1}
            for axes, curve in ((left, _palm_tree(vehicle)), (right, _encoder(vehicle))):
                if curve is not None:
                    axes.plot(*curve, **look)
        left.set_ylabel("front wheel angle (degrees)")
        right.set_ylabel("encoder (1000 counts)")
        for axes in (left, right):
            axes.set_xlabel("potentiometer from straight (V)")
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
            if axes.lines:
                axes.legend(loc="best")
            else:
                axes.text(0.5, 0.5, "not calibrated", ha="center", color=MUTED, transform=axes.transAxes)
        figure.suptitle("Steering curves")
        write_caption(
            figure,
            "Left: front wheel angle, the measured map where the file has one. Right: encoder. Both start at each "
            "vehicle's straight position.",
        )


def draw_fleet_numbers(fleet: Fleet, path: str | Path, *, force: bool = False) -> None:
    """Draw each estimated number's deviation from the vehicles' mean, in per cent, with its 95 % interval.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    names, estimated = fleet.names, fleet.estimated
    value, low, high = (
        np.reshape([getattr(each, name) for each in estimated], (len(estimated), len(names)))
        for name in ("value", "low", "high")
    )
    # A mean of zero, or near it, has no per cent: the largest magnitude serves.
    mean = np.nanmean(value, axis=1, keepdims=True)
    unit = np.maximum(np.abs(mean), 0.1 * np.nanmax(np.abs(value), axis=1, keepdims=True))
    unit = np.where(unit > 0.0, unit, 1.0)
    at, first, last = (np.clip(100.0 * (each - mean) / unit, -_BEYOND, _BEYOND) for each in (value, low, high))
    with picture(path, 9.0, 1.6 + _ROW_IN * max(len(estimated), 4), force) as figure:
        axes = figure.subplots()
        rows = np.arange(len(estimated), dtype=float)
        for place, name in enumerate(names):
            shift = 0.5 * ((place + 0.5) / len(names) - 0.5)
            colour = _COLOURS[place % len(_COLOURS)]
            axes.hlines(rows + shift, first[:, place], last[:, place], color=colour, linewidth=1.6)
            marker = _MARKERS[place % len(_MARKERS)]
            axes.plot(at[:, place], rows + shift, marker, color=colour, markersize=4.5, label=name)
        axes.axvline(0.0, color=FAINT, linewidth=0.8)
        axes.set_yticks(rows, [each.path for each in estimated])
        for label, each in zip(axes.get_yticklabels(), estimated, strict=True):
            label.set_fontweight("bold" if each.differs else "normal")
        axes.set_ylim(len(estimated) - 0.4, -0.6)
        axes.set_xlim(-1.05 * _BEYOND, 1.05 * _BEYOND)
        axes.set_xlabel("deviation from the mean of the vehicles (%)")
        axes.grid(axis="x", color=MUTED, alpha=0.2, linewidth=0.6)
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=min(len(names), 4))
        write_caption(
            figure,
            f"Values with 95 % intervals. Bold: differs by more than chance. Deviations beyond {_BEYOND:g} % are drawn "
            "at the rim.",
        )


def _palm_tree(vehicle: VehicleFile) -> tuple[Float[np.ndarray, " knot"], Float[np.ndarray, " knot"]] | None:
    """Volts from straight, and degrees."""
    steering, measured = vehicle.steering, vehicle.wheel_map
    if measured is not None:
        volts = measured.first_v + measured.step_v * np.arange(len(measured.front_rad))
        angle = np.degrees(measured.front_rad)
        order = np.argsort(angle)
        straight = np.interp(0.0, angle[order], volts[order])
        return volts - straight, angle
    if steering.potentiometer_v_per_rad is None:
        return None
    largest_rad = steering.largest_wheel_angle_rad or 0.5
    angle_rad = np.linspace(-largest_rad, largest_rad, 21)
    return angle_rad * steering.potentiometer_v_per_rad, np.degrees(angle_rad)


def _encoder(vehicle: VehicleFile) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]] | None:
    """Volts from straight, and thousands of counts."""
    tree, steering = _palm_tree(vehicle), vehicle.steering
    if tree is None:
        return None
    if steering.encoder_counts_per_v is not None:
        return tree[0], 1e-3 * steering.encoder_counts_per_v * tree[0]
    if steering.encoder_counts_per_rad is not None:
        return tree[0], 1e-3 * steering.encoder_counts_per_rad * np.radians(tree[1])
    return None
