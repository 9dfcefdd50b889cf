"""Input files for gprMax: flat ground, what is buried in it, and the antenna's places.

A model is written in the scene's terms: metres along the track, depth below the surface. In two dimensions
everything runs on across the track, and so does the field (TM, Ez): the wave obeys the scalar wave equation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

HEIGHT_M = 0.3  # of the antenna above the ground
# Source and receiver stand on either side of the antenna's place. Against one antenna in the middle an echo comes
# later by separation**2 / (4 c L), with L = height + depth/n the distance of the mirror image: below 0.003 ns here.
SEPARATION_M = 0.04
PERMITTIVITY = 9.0  # of the soil: surface reflection (1 - 3)/(1 + 3) = -0.5, the scene's
CENTRE_HZ = 250e6  # of the Ricker pulse
PLATE_M = 0.5  # of the reference plate from the antenna
# Of the two-dimensional models: 50 cells in the band's shortest wavelength in the soil. On the grid the wave is
# slower by (k cell)**2 / 24, 0.03 % at 250 MHz: an echo after 12 ns in the soil is 0.003 ns late.
CELL_M = 0.005
# Radius of a small object in two dimensions, k a = 0.16: what multiple scattering inside it adds to the phase stays
# below pi/4 (k a)**2 |permittivity ratio - 1| = 0.02 rad, 0.013 ns.
SMALL_M = 0.01


@dataclass(frozen=True)
class Slab:
    """Everything below a depth, one value a column of cells or the same for all; the later slab wins."""

    depth_m: Float[np.ndarray, " column"] | float
    permittivity: float


@dataclass(frozen=True)
class Ball:
    """A cylinder across the track in two dimensions, a sphere in three, below the track's middle line."""

    along_m: float
    depth_m: float
    radius_m: float
    permittivity: float


@dataclass(frozen=True)
class Plate:
    """A metal plate above the ground, under the antenna."""

    depth_m: float


@dataclass(frozen=True)
class Model:
    """What is computed.

    Attributes:
        along_m: extent along the track, absorbing boundaries (10 cells) included. Two models that share a background
            share the extent.
        below_m, above_m: extent below and above the surface.
        cross_m: extent across the track; None for two dimensions.
        cell_m: edge of the cells; what is buried should lie on them.
        window_ns: length of a trace.
        parts: soil first, then what lies in it. Without soil everything is air.
        lines: further lines of the input file, as gprMax reads them.
    """

    along_m: tuple[float, float]
    below_m: float
    above_m: float
    cell_m: float
    window_ns: float
    parts: tuple[Slab | Ball | Plate, ...] = ()
    cross_m: float | None = None
    lines: tuple[str, ...] = ()

    def with_parts(self, *parts: Slab | Ball | Plate) -> "Model":
        """The same model with more in it."""
        return replace(self, parts=self.parts + parts)

    def columns_m(self) -> Float[np.ndarray, " column"]:
        """Places along the track of the middles of the cells, for a slab of changing depth."""
        low, high = self.along_m
        return low + (np.arange(round((high - low) / self.cell_m)) + 0.5) * self.cell_m


SOIL = Slab(0.0, PERMITTIVITY)


def write_input(model: Model, antenna_m: Sequence[float], file: Path) -> None:
    """Writes the input file, and beside it the antenna's places (along the track) as a study."""
    low, high = model.along_m
    plane = model.cross_m is None
    cross, middle = ("inf", "inf") if model.cross_m is None else (f"{model.cross_m:g}", f"{model.cross_m / 2:g}")
    lines = [
        f"#title: {file.stem}",
        *(["#domain_mode: TM"] if plane else []),
        f"#domain: {high - low:g} {model.below_m + model.above_m:g} {cross}",
        "#dx_dy_dz: " + " ".join([f"{model.cell_m:g}"] * 3),
        f"#time_window: {model.window_ns * 1e-9:g}",
        "#num_threads: 1",
        f"#waveform: ricker 1 {CENTRE_HZ:g} pulse",
        f"#hertzian_dipole: z {{transmitter}} {middle} pulse",
        f"#rx: {{receiver}} {middle}",
        *model.lines,
    ]
    for number, part in enumerate(model.parts):
        lines += _part_lines(model, part, f"material{number}", cross)
    up = model.below_m + HEIGHT_M
    places = [[f"{x - low + side * SEPARATION_M / 2:.6g} {up:.6g}" for side in (-1, 1)] for x in antenna_m]
    text = "\n".join([*lines, f"#study: gpr {file.stem}.csv", ""])
    file.write_text(text.replace("{transmitter}", places[0][0]).replace("{receiver}", places[0][1]))
    z_m = "0" if plane else middle
    rows = ["case_id,object_id,x_m,y_m,z_m"]
    for number, pair in enumerate(places):
        for name, place in zip(("hertzian_dipole_1", "rx_1"), pair, strict=True):
            rows.append(f"trace{number},{name},{place.replace(' ', ',')},{z_m}")
    file.with_suffix(".csv").write_text("\n".join([*rows, ""]))


def _part_lines(model: Model, part: Slab | Ball | Plate, name: str, cross: str) -> list[str]:
    low, high = model.along_m
    if isinstance(part, Plate):
        up = f"{model.below_m - part.depth_m:g}"
        # In two dimensions a plate would be a line; a layer of metal one cell thick has the same upper face.
        under = f"{model.below_m - part.depth_m - model.cell_m:g}"
        return [f"#box: 0 {under} 0 {high - low:g} {up} {cross} pec"]
    material = f"#material: {part.permittivity:g} 0 1 0 {name}"
    if isinstance(part, Ball):
        x, y, r = part.along_m - low, model.below_m - part.depth_m, part.radius_m
        if model.cross_m is None:
            return [material, f"#cylinder: {x:.6g} {y:.6g} 0 {x:.6g} {y:.6g} inf {r:g} {name}"]
        return [material, f"#sphere: {x:.6g} {y:.6g} {model.cross_m / 2:g} {r:g} {name}"]
    if isinstance(part.depth_m, float):
        return [material, f"#box: 0 0 0 {high - low:g} {model.below_m - part.depth_m:g} {cross} {name}"]
    boxes = []
    for number, depth_m in enumerate(part.depth_m):
        top = round((model.below_m - depth_m) / model.cell_m) * model.cell_m
        left, right = number * model.cell_m, (number + 1) * model.cell_m
        boxes.append(f"#box: {left:.6g} 0 0 {right:.6g} {top:.6g} {cross} {name}")
    return [material, *boxes]
