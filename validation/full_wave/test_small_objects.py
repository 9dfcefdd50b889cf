"""A small object seen from several places: the hyperbola with its refraction, and which sign is which."""

import numpy as np
import pytest

from validation.full_wave.echoes import LIGHT_M_PER_NS, MIDDLE_GHZ, Pick, pick, to_scene
from validation.full_wave.fdtd import Fdtd, Recording, subtract
from validation.full_wave.fdtd_model import CELL_M, HEIGHT_M, PERMITTIVITY, PLATE_M, SMALL_M, SOIL, Ball, Model, Plate
from validation.full_wave.plane_waves import with_waves
from validation.full_wave.scenes import DENSE_STONE_M, VOID_STONE_M, render
from validation.full_wave.tables import NEAR_M, Row, judge, show

DEPTH_M = 0.6
ASIDE_M = [0.0, 0.2, 0.4, 0.6, 0.8]
LINE = Model((-0.5, 1.3), below_m=1.0, above_m=0.5, cell_m=CELL_M, window_ns=36.0, parts=(SOIL,))
OBJECTS = {"dense": (2 * PERMITTIVITY, DENSE_STONE_M), "void": (1.0, VOID_STONE_M)}


@pytest.mark.parametrize("name", list(OBJECTS))
def test_hyperbola(fdtd: Fdtd, plate: Recording, name: str) -> None:
    """Two dimensions. The object moves instead of the antenna, so that one background fits all, exactly.

    The straight ray, without refraction, would be 3 ns late at 0.6 m aside.
    """
    permittivity, strength_m = OBJECTS[name]
    background = fdtd("line", LINE, [0.0])
    rays, waves = [], []
    for aside_m in ASIDE_M:
        model = LINE.with_parts(Ball(aside_m, DEPTH_M, SMALL_M, permittivity))
        echo = subtract(fdtd(f"{name}_{aside_m:.1f}_", model, [0.0]), background)
        found = pick(to_scene(echo, plate, PLATE_M, small=True)[0])
        scene = render([0.0], stones=[(aside_m, DEPTH_M, strength_m)])[0]
        label = f"{name}, {aside_m:.1f} m aside"
        rays.append(Row(label, pick(scene), found))
        waves.append(Row(label, pick(with_waves(scene, aside_m, DEPTH_M)), found))
    show("small object in two dimensions, the scene as it is", rays)
    show("small object in two dimensions, the scene's ray with the exact field of the line source", waves)
    judge([row for row, aside_m in zip(rays, ASIDE_M, strict=True) if aside_m <= NEAR_M])
    judge(waves)


def near_field_ns() -> float:
    """How much later than the ray a dipole's echo from straight below comes, in three dimensions.

    The field below the surface is a sum of plane waves, exp(-i (kz h + kz' d)). Up to the second order in their
    angles they make the ray, exp(-i k (h + n d)) / (h + d/n). The fourth order leaves the factor
    1 - i (h + d/n**3) / (k (h + d/n)**2), one way, with the air's k: what 1 - i / (k r) is beside a dipole in air.
    (What the surface lets through changes with the angle too, but for n = 3 by opposite amounts in the two
    polarisations.) It is 0.31 ns here; in two dimensions, where the same terms nearly cancel, 0.01 ns.
    """
    index = np.sqrt(PERMITTIVITY)
    k = 2 * np.pi * MIDDLE_GHZ / LIGHT_M_PER_NS
    term = (HEIGHT_M + DEPTH_M / index**3) / (k * (HEIGHT_M + DEPTH_M / index) ** 2)
    return float(2 * np.arctan(term) / (2 * np.pi * MIDDLE_GHZ))


def test_sign_of_a_stone_in_three_dimensions(fdtd: Fdtd) -> None:
    """Spheres below the antenna: a denser one returns the pulse as it was sent, a void turns it over.

    It is the other way round at an interface. What a small object has in excess of the soil, x = ratio - 1, radiates
    k**2 x times the field there, k**2 > 0. A sheet of such objects returns k**2 x / (2 i k) a metre of depth; sheets
    from a depth on downwards, the integral of exp(-2 i k z), 1/(2 i k) times that: -x/4, turned over.
    """
    cell_m = 0.0125  # 20 cells in the shortest wavelength: the echo 0.02 ns late
    air = Model((-0.4, 0.4), below_m=0.95, above_m=0.6, cell_m=cell_m, window_ns=26.0, cross_m=0.8)
    background = fdtd("cube", air.with_parts(SOIL), [0.0])
    metal = fdtd("cube_plate", air.with_parts(Plate(PLATE_M - HEIGHT_M)), [0.0])
    plate = subtract(metal, fdtd("cube_air", air, [0.0]))
    rays, near = [], []
    for name, (permittivity, strength_m) in OBJECTS.items():
        sphere = Ball(0.0, DEPTH_M, 0.025, permittivity)
        echo = subtract(fdtd(f"cube_{name}", air.with_parts(SOIL, sphere), [0.0]), background)
        found = pick(to_scene(echo, plate, PLATE_M, small=True, cross=True)[0])
        scene = pick(render([0.0], stones=[(0.0, DEPTH_M, strength_m)])[0])
        rays.append(Row(f"{name} sphere", scene, found))
        near.append(Row(f"{name} sphere", Pick(scene.time_ns + near_field_ns(), scene.value), found))
    show("small object in three dimensions, the scene as it is", rays)
    show("small object in three dimensions, the scene's ray with a dipole's near field", near)
    judge(near)
