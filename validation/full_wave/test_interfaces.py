"""Interfaces: echoes of gprMax and of the scene come at the same time, with the same polarity."""

import numpy as np
import pytest

from validation.full_wave.echoes import pick, to_scene
from validation.full_wave.fdtd import Fdtd, Recording, subtract
from validation.full_wave.fdtd_model import CELL_M, HEIGHT_M, PERMITTIVITY, PLATE_M, SMALL_M, SOIL, Ball, Model, Slab
from validation.full_wave.plane_waves import with_waves
from validation.full_wave.scenes import DENSE_STONE_M, render
from validation.full_wave.tables import NEAR_M, Row, judge, show

FLAT = Model((-0.9, 0.9), below_m=1.1, above_m=0.5, cell_m=CELL_M, window_ns=34.0, parts=(SOIL,))
RELIEF_M, WAVE_RAD_PER_M, DEPTH_M = 0.06, 2 * np.pi / 3.0, 0.8
WAVY = Model((-1.2, 1.3), below_m=1.2, above_m=0.5, cell_m=CELL_M, window_ns=34.0, parts=(SOIL,))
ANTENNA_M = [-0.6, -0.2, 0.1, 0.3, 0.7]
OBJECT = Ball(0.1, 0.45, SMALL_M, 2 * PERMITTIVITY)


def fresnel(upper: float, lower: float) -> float:
    """Reflection coefficient of an interface seen from above, from the permittivities."""
    return float((np.sqrt(upper) - np.sqrt(lower)) / (np.sqrt(upper) + np.sqrt(lower)))


def test_flat_interfaces(fdtd: Fdtd, plate: Recording) -> None:
    """One to denser soil, one to lighter soil, and both in one ground."""
    background = fdtd("flat", FLAT, [0.0])
    rows = []
    for name, depth_m, permittivity in (("denser", 0.5, 16.0), ("lighter", 0.8, 4.0)):
        echo = subtract(fdtd(name, FLAT.with_parts(Slab(depth_m, permittivity)), [0.0]), background)
        trace = to_scene(echo, plate, PLATE_M, small=False)[0]
        mirror = render([0.0], depth_m=depth_m, reflectivity=fresnel(PERMITTIVITY, permittivity))[0]
        rows.append(Row(f"{depth_m} m, to {name} soil", pick(mirror), pick(trace)))
        # The scene's mirror falls with the distance L of the image, a line source's with its root; what is left of
        # both is the reflection coefficient times the two passages of the surface.
        image_m = 2 * (HEIGHT_M + depth_m / np.sqrt(PERMITTIVITY))
        assert rows[-1].scene.value * image_m == pytest.approx(rows[-1].fdtd.value * np.sqrt(image_m), rel=0.02)

    # Two in one ground. The scene knows one velocity; an interface below others lies at its optical depth.
    stacked = FLAT.with_parts(Slab(0.45, 10.24), Slab(0.75, 6.25))
    only_upper = fdtd("upper", FLAT.with_parts(Slab(0.45, 10.24)), [0.0])
    second = to_scene(subtract(fdtd("both", stacked, [0.0]), only_upper), plate, PLATE_M, small=False)[0]
    first = to_scene(subtract(only_upper, background), plate, PLATE_M, small=False)[0]
    optical_m = 0.45 + 0.3 * np.sqrt(10.24 / PERMITTIVITY)
    upper = render([0.0], depth_m=0.45, reflectivity=fresnel(PERMITTIVITY, 10.24))[0]
    lower = render([0.0], depth_m=optical_m, reflectivity=fresnel(10.24, 6.25))[0]
    rows += [Row("of two: to denser soil", pick(upper), pick(first))]
    rows += [Row("of two: to lighter soil below", pick(lower), pick(second))]
    show("flat interfaces", rows)
    judge(rows)


def test_undulating_interface_and_object(fdtd: Fdtd, plate: Recording) -> None:
    """An interface that rises and falls by 0.12 m in 1.5 m, a denser object above it, five places of the antenna."""
    depth_m = DEPTH_M + RELIEF_M * np.sin(WAVE_RAD_PER_M * WAVY.columns_m())
    interface = WAVY.with_parts(Slab(depth_m, 12.25))
    bare = fdtd("bare", WAVY, ANTENNA_M)
    layered = fdtd("layered", interface, ANTENNA_M)
    everything = fdtd("everything", interface.with_parts(OBJECT), ANTENNA_M)
    mirrors = to_scene(subtract(layered, bare), plate, PLATE_M, small=False)
    objects = to_scene(subtract(everything, layered), plate, PLATE_M, small=True)
    reflectivity = fresnel(PERMITTIVITY, 12.25)
    scene_mirrors = render(
        ANTENNA_M, depth_m=DEPTH_M, relief_m=RELIEF_M, wave_rad_per_m=WAVE_RAD_PER_M, reflectivity=reflectivity
    )
    scene_objects = render(ANTENNA_M, stones=[(OBJECT.along_m, OBJECT.depth_m, DENSE_STONE_M)])
    interfaces, rays, waves = [], [], []
    for number, x in enumerate(ANTENNA_M):
        interfaces.append(Row(f"interface, antenna at {x:+.1f} m", pick(scene_mirrors[number]), pick(mirrors[number])))
        aside_m = abs(x - OBJECT.along_m)
        found, ray = pick(objects[number]), scene_objects[number]
        rays.append(Row(f"object, {aside_m:.1f} m aside", pick(ray), found))
        waves.append(rays[-1]._replace(scene=pick(with_waves(ray, aside_m, OBJECT.depth_m))))
    show("undulating interface, and an object above it; the scene as it is", interfaces + rays)
    show("the object, the scene's ray with the exact field of the line source", waves)
    near = [abs(x - OBJECT.along_m) <= NEAR_M for x in ANTENNA_M]
    judge(interfaces + [row for row, close in zip(rays, near, strict=True) if close])
    judge(waves)
