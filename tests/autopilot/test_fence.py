"""The fence: its geometry on the host, and that no stop ever crosses it, held against matplotlib's polygons."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from jaxtyping import Array, Float
from matplotlib.path import Path as Polygon

from lgprjax.autopilot import StopRules, edge_ahead, pad_fence
from lgprjax.autopilot.limiter import slowed
from lgprjax.coverage import Tool, outline_of
from lgprjax.coverage.field import Corners
from lgprjax.coverage.ground import ground_around
from lgprjax.vehicle import VehiclePose, WheelSpeeds, drive_skid_arc
from refusals import refused

SQUARE = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
NOTCH = [[6.0, 10.0], [6.0, 5.0], [5.0, 5.0], [5.0, 10.0]]
NOTCHED = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], *NOTCH, [0.0, 10.0]])
OUTLINE = outline_of(Tool(1.2, 0.3, 1.2, 0.1))
TRACK_M, STEP_S, DELAY_TICKS, LAG_S = 1.1, 0.05, 4, 0.2
STEPS, LANES = 400, 100
SURE = jnp.float32(0.0)


def fence_around(corners: Corners, room_m: float) -> Corners:
    ((fence,),) = ground_around(corners, room_m, 0.0).polygons_m
    return fence


def test_a_fence_around_a_square_is_the_larger_square() -> None:
    fence = fence_around(SQUARE, 2.0)
    np.testing.assert_allclose(sorted(fence.tolist()), [[-2, -2], [-2, 12], [12, -2], [12, 12]], atol=1e-12)


def test_a_sharp_corner_is_cut_off() -> None:
    needle = np.array([[0.0, 0.0], [20.0, -1.0], [20.0, 1.0]])
    fence = fence_around(needle, 1.0)
    assert len(fence) == 4
    assert fence[:, 0].min() > -2.1


def test_every_place_within_the_room_is_inside_the_fence() -> None:
    rng = np.random.default_rng(1)
    for corners, room in ((SQUARE, 1.5), (NOTCHED, 0.3), (np.array([[0.0, 0.0], [9.0, 1.0], [2.0, 7.0]]), 2.0)):
        fence = Polygon(fence_around(corners, room))
        share = rng.random((500, 1))
        start = rng.integers(len(corners), size=500)
        side = corners[start] * (1.0 - share) + corners[(start + 1) % len(corners)] * share
        angle = rng.uniform(0.0, 2.0 * np.pi, 500)
        near = side + 0.999 * room * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert fence.contains_points(near).all()


def test_what_makes_no_fence_is_refused() -> None:
    with refused("corners", 3, 4096, found=2):
        pad_fence(SQUARE[:2])
    with refused("corners"):
        pad_fence(np.where(SQUARE > 9.0, np.nan, SQUARE))
    with refused("sides"):
        pad_fence(SQUARE[[0, 2, 1, 3]])


RULES = StopRules(*(jnp.float32(value) for value in (0.5, 0.6, 0.05, 3.0)))


@jax.jit
def drive_until_stopped(
    fence: Float[Array, "side 2 2"], start: Float[Array, "lane 3"], wheels: Float[Array, "lane 2"]
) -> Float[Array, "step lane 3"]:
    """Lanes that hold their wheels until the fence is foretold, then brake; the plant is late and slow."""

    def lane(carried, wanted):  # type: ignore[no-untyped-def]
        pose, told, waiting, turning, stops = carried
        track = jnp.float32(TRACK_M)
        foretold = edge_ahead(
            RULES, fence, OUTLINE, track, pose, WheelSpeeds(wanted[0], wanted[1]), jnp.float32(0.0), jnp.float32(0.0)
        )
        foretold |= edge_ahead(
            RULES, fence, OUTLINE, track, pose, WheelSpeeds(*turning), jnp.float32(0.0), jnp.float32(0.0)
        )
        stops = stops | foretold
        halted = jnp.stack(slowed(told[0], told[1], RULES.stop_mps2 * STEP_S))
        told = jnp.where(stops, halted, told + jnp.clip(wanted - told, -0.04, 0.04))
        waiting = jnp.concatenate([told[None], waiting[:-1]])
        turning = turning + (1.0 - jnp.exp(-STEP_S / LAG_S)) * (waiting[-1] - turning)
        pose = drive_skid_arc(pose, track, WheelSpeeds(*turning), jnp.float32(STEP_S))
        return (pose, told, waiting, turning, stops), jnp.stack(pose)

    def step(carried, _):  # type: ignore[no-untyped-def]
        return jax.vmap(lane)(carried, wheels)  # type: ignore[no-untyped-call]

    begun = (
        VehiclePose(*start.T),
        jnp.zeros_like(wheels),
        jnp.zeros((len(wheels), DELAY_TICKS + 1, 2), jnp.float32),
        jnp.zeros_like(wheels),
        jnp.zeros(len(wheels), jnp.bool_),
    )
    poses: Float[Array, "step lane 3"] = jax.lax.scan(step, begun, None, STEPS)[1]
    return poses


def outline(poses: Float[np.ndarray, "place 3"]) -> Float[np.ndarray, "place point 2"]:
    """Places all round the rectangle that holds the tool and the reference point, a few centimetres apart."""
    front, rear, left, right = 1.35, 0.0, 0.7, -0.5
    along, across = np.linspace(rear, front, 20), np.linspace(right, left, 20)
    x = np.concatenate([along, along, np.full(20, front), np.full(20, rear)])
    y = np.concatenate([np.full(20, left), np.full(20, right), across, across])
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    return np.stack([poses[:, :1] + cos * x - sin * y, poses[:, 1:2] + sin * x + cos * y], axis=-1)


def draw_fence(rng: np.random.Generator, corners: int) -> Float[np.ndarray, "corner 2"]:
    """A star about the origin, convex or not."""
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, corners)) + np.linspace(0.0, 1e-3, corners)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(5.0, 9.0, (corners, 1))


@pytest.mark.parametrize("seed", [0, 2])
def test_no_part_of_the_vehicle_ever_crosses_a_fence(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = SQUARE - 5.0 if seed == 0 else draw_fence(rng, 5 + 3 * seed)
    start = np.zeros((LANES, 3))
    start[:, 2] = rng.uniform(-np.pi, np.pi, LANES)
    speed, turn = rng.uniform(0.1, 1.0, LANES), rng.uniform(-0.3, 0.3, LANES)
    wheels = np.stack([speed - turn, speed + turn], axis=1)
    fence = Polygon(corners)
    fits = fence.contains_points(outline(start).reshape(-1, 2)).reshape(LANES, -1).all(axis=1)
    assert fits.sum() > LANES // 2
    poses = drive_until_stopped(pad_fence(corners), jnp.asarray(start, jnp.float32), jnp.asarray(wheels, jnp.float32))
    every = np.asarray(poses, np.float64)[:, fits]
    places = outline(every.reshape(-1, 3)).reshape(-1, 2)
    assert fence.contains_points(places).all()
    # Those that would have left came near: the fence stops, it does not keep the vehicle from driving.
    gone = np.hypot(*(every[-1, :, :2] - every[0, :, :2]).T)
    assert np.median(gone) > 1.0


@jax.jit
def foretold(
    pose: VehiclePose, wheels: WheelSpeeds, sigma_m: Float[Array, ""], sigma_yaw_rad: Float[Array, ""]
) -> Array:
    return edge_ahead(RULES, pad_fence(SQUARE), OUTLINE, jnp.float32(TRACK_M), pose, wheels, sigma_m, sigma_yaw_rad)


def test_beyond_the_fence_or_with_no_numbers_it_is_foretold() -> None:
    sigma, standing = jnp.float32(0.01), WheelSpeeds(SURE, SURE)

    def told(x_m: float, y_m: float, sigma_m: Float[Array, ""] = sigma) -> bool:
        pose = VehiclePose(jnp.float32(x_m), jnp.float32(y_m), jnp.float32(0.0))
        return bool(foretold(pose, standing, sigma_m, SURE))

    assert not told(5.0, 5.0)
    assert told(15.0, 5.0)
    assert told(9.0, 5.0)
    assert told(float("nan"), 5.0)
    assert told(5.0, 5.0, jnp.float32(jnp.nan))
    assert told(5.0, 5.0, jnp.float32(2.0))
    driving = WheelSpeeds(jnp.float32(0.5), jnp.float32(jnp.nan))
    at = VehiclePose(jnp.float32(5.0), jnp.float32(5.0), jnp.float32(0.0))
    assert bool(foretold(at, driving, sigma, SURE))


def test_beside_a_field_and_within_a_keep_out_it_is_foretold_and_nowhere_else() -> None:
    """A vehicle that stands on ground with two keep-outs, one larger and one smaller than it; judged by shapely."""
    rings = (
        NOTCHED * 2.0,
        np.array([[2.0, 2.0], [8.0, 2.5], [7.0, 9.0]]),
        np.array([[14.0, 4], [14.3, 4], [14.1, 4.3]]),
    )
    ground, fence = shapely.Polygon(rings[0], rings[1:]), pad_fence(*rings)
    rng = np.random.default_rng(5)
    poses = np.concatenate([rng.uniform(-6.0, 26.0, (4000, 2)), rng.uniform(-np.pi, np.pi, (4000, 1))], axis=1)

    @jax.jit
    def told(places: Float[Array, "place 3"]) -> Array:
        standing = WheelSpeeds(SURE, SURE)
        return jax.vmap(
            lambda at: edge_ahead(RULES, fence, OUTLINE, jnp.float32(TRACK_M), VehiclePose(*at), standing, SURE, SURE)
        )(places)

    found = np.asarray(told(jnp.asarray(poses, jnp.float32)))
    rectangles = np.array([shapely.Polygon(corners) for corners in _grown(poses, float(RULES.margin_m))])
    allowed = shapely.contains(ground, rectangles)
    clear = shapely.distance(ground.boundary, rectangles) > 1e-4
    clear |= shapely.area(shapely.intersection(ground, rectangles)) < 0.999 * shapely.area(rectangles)
    np.testing.assert_array_equal(found[clear], ~allowed[clear])
    keep_out = shapely.contains(shapely.Polygon(rings[1]), rectangles)
    assert keep_out.sum() > 20
    assert found[keep_out].all()
    assert allowed.sum() > 200


def _grown(poses: Float[np.ndarray, "place 3"], margin_m: float) -> Float[np.ndarray, "place 4 2"]:
    """Corners of the rectangle that holds the tool and the reference point, larger by a margin."""
    front, rear, left, right = 1.35 + margin_m, -margin_m, 0.7 + margin_m, -0.5 - margin_m
    x, y = np.array([front, rear, rear, front]), np.array([left, left, right, right])
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    return np.stack([poses[:, :1] + cos * x - sin * y, poses[:, 1:2] + sin * x + cos * y], axis=-1)


@pytest.mark.parametrize("sigma_yaw_deg", [0.2, 4.0])
def test_no_corner_is_beyond_the_fence_whichever_way_an_uncertain_heading_is_wrong(sigma_yaw_deg: float) -> None:
    """A vehicle that stands beside a side of the fence, its position known; the heading is three sigma off at most."""
    standing, sigma, allowed = WheelSpeeds(SURE, SURE), np.radians(sigma_yaw_deg), 0
    for y_m in np.linspace(5.0, 10.0, 101):
        at = VehiclePose(jnp.float32(5.0), jnp.float32(y_m), jnp.float32(0.0))
        if bool(foretold(at, standing, SURE, jnp.float32(sigma))):
            continue
        allowed += 1
        yaw = np.linspace(-3.0, 3.0, 25) * sigma
        places = outline(np.stack([np.full(25, 5.0), np.full(25, y_m), yaw], axis=1)).reshape(-1, 2)
        assert Polygon(SQUARE).contains_points(places).all()
    assert 20 < allowed < 101
