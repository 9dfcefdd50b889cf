"""Live scans: what the filter holds from block to block, templates at their places, and which windows a stop has."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.radar import ArrayGeometry, CoefficientBasis, uniform_array
from lgprjax.registration import LiveChain, LiveScans, Stops, Template, Track, stops_of, templates_of

SAMPLES = 6
BASIS = CoefficientBasis(jnp.ones(SAMPLES), jnp.eye(SAMPLES), jnp.ones(SAMPLES // 2))


def identity_chain(channels: int, zero_slip_m: float = 0.0) -> LiveChain:
    return LiveChain(
        lambda _: jnp.eye(SAMPLES),
        BASIS,
        track_filter_m=4.0,
        channels=channels,
        recorded=SAMPLES,
        zero_slip_m=zero_slip_m,
    )


def track(east: np.ndarray, north: np.ndarray, yaw: np.ndarray, travel: np.ndarray, speed: float = 0.0) -> Track:
    zeros = np.zeros_like(travel)
    pose = np.stack([east, north, zeros, yaw, zeros], axis=1)
    return Track(pose, travel, np.full_like(travel, speed), zeros + 0.01, zeros + 0.05, np.zeros(len(travel), np.int64))


def straight(scans: int, step_m: float, speed: float = 0.0) -> Track:
    travel = np.arange(scans) * step_m
    return track(travel, 0.0 * travel, 0.0 * travel, travel, speed)


def feed(chain: LiveChain, where: Track, channels: int, block: int = 256) -> LiveScans:
    rng = np.random.default_rng(0)
    scans = len(where.travel_m)
    traces = rng.normal(size=(scans, channels, SAMPLES)).astype(np.float32)
    return chain.feed(traces, np.ones((scans, channels), bool), where, block)


def stops_at(scans: LiveScans, chosen: np.ndarray, array: ArrayGeometry, chain: LiveChain) -> Stops:
    stops = stops_of(scans, chosen, array, BASIS)
    return stops._replace(coefficients=chain.coefficients(stops.filtered, stops.valid, 1.0))


def template_of(where: Track, array: ArrayGeometry, chosen: np.ndarray) -> tuple[Template, Stops]:
    """All chosen scans as one template that ends with the last one, newest first."""
    chain = identity_chain(len(array.x_m), array.zero_slip_m)
    stops = stops_at(feed(chain, where, len(array.x_m)), chosen, array, chain)
    member = np.arange(len(chosen))[::-1][None]
    return templates_of(stops, array, np.array([len(chosen) - 1]), member, np.ones(member.shape, bool)), stops


def test_a_template_looks_back_along_the_way() -> None:
    array = uniform_array(3, 0.4, x_m=2.0)
    template, stops = template_of(straight(60, 0.05), array, np.arange(8, 60, 5))
    offset = np.asarray(template.offset_m).reshape(11, 3, 2)
    np.testing.assert_allclose(offset[:, :, 0], np.broadcast_to(-0.25 * np.arange(11)[:, None], (11, 3)), atol=1e-6)
    np.testing.assert_allclose(offset[:, :, 1], np.broadcast_to([0.4, 0.0, -0.4], (11, 3)), atol=1e-6)
    np.testing.assert_array_equal(np.asarray(template.scan).reshape(11, 3), np.arange(11)[:, None] * np.ones(3))
    wanted = stops.coefficients[::-1].reshape(33, -1)
    np.testing.assert_array_equal(np.asarray(template.coefficients)[0], wanted)


def test_members_that_are_none_weigh_nothing() -> None:
    array = uniform_array(2, 0.4)
    chain = identity_chain(2)
    stops = stops_at(feed(chain, straight(30, 0.05), 2), np.arange(0, 30, 3), array, chain)
    member = np.array([[9, 8, 8, 7]])
    fresh = np.array([[True, True, False, True]])
    template = templates_of(stops, array, np.array([9]), member, fresh)
    valid = np.asarray(template.valid).reshape(4, 2)
    assert valid.tolist() == [[True] * 2, [True] * 2, [False] * 2, [True] * 2]
    assert not np.asarray(template.coefficients).reshape(4, 2, -1)[2].any()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_channels_stand_where_the_vehicle_had_come(sign: float) -> None:
    """The last of four channels is switched on 0.75 of a period late: 3.75 cm farther on at 5 m/s."""
    array = uniform_array(4, 0.1, scan_period_s=0.01)
    template, _ = template_of(straight(5, 0.05 * sign, speed=5.0 * sign), array, np.array([4]))
    np.testing.assert_allclose(template.offset_m[0, :, 0], sign * np.array([0.0, 0.0125, 0.025, 0.0375]), atol=1e-6)


@pytest.mark.parametrize("zero_slip_m", [0.0, 1.2])
def test_a_template_bends_with_the_road(zero_slip_m: float) -> None:
    """Rear axle, or a point ahead of it, on a circle of 20 m, array 3 m ahead and 0.2 m to the left: every antenna by
    hand.
    """
    radius, ahead, aside = 20.0, 3.0, 0.2
    travel = np.arange(120) * 0.05
    yaw = travel / radius
    array = ArrayGeometry(np.array([ahead, ahead]), np.array([aside + 0.5, aside - 0.5]), np.zeros(2), 0.3, zero_slip_m)
    still = np.stack([radius * np.sin(yaw), radius * (1 - np.cos(yaw))], axis=1)

    def antenna(scan: int, y: float) -> np.ndarray:
        c, s = np.cos(yaw[scan]), np.sin(yaw[scan])
        x = ahead - zero_slip_m
        return np.asarray(still[scan] + [c * x - s * y, s * x + c * y])

    centre = np.array([antenna(scan, aside) for scan in range(120)])
    chosen = np.arange(30, 111, 2)
    template, _ = template_of(track(centre[:, 0], centre[:, 1], yaw, travel), array, chosen)
    offset = np.asarray(template.offset_m)[0]
    c, s = np.cos(yaw[110]), np.sin(yaw[110])
    for back in (0, 10, 25, 39):
        for channel, y in enumerate((aside + 0.5, aside - 0.5)):
            apart = antenna(110 - 2 * back, y) - centre[110]
            by_hand = [c * apart[0] + s * apart[1], c * apart[1] - s * apart[0]]
            np.testing.assert_allclose(offset[2 * back + channel], by_hand, atol=6e-3)


def test_gnss_jumps_do_not_bend_a_template() -> None:
    where, array, chosen = straight(60, 0.05), uniform_array(3, 0.4), np.arange(10, 51, 5)
    jumped = where.pose.copy()
    jumped[30:, :2] += [3.0, -2.0]
    smooth, _ = template_of(where, array, chosen)
    after, _ = template_of(where._replace(pose=jumped), array, chosen)
    np.testing.assert_array_equal(np.asarray(after.offset_m), np.asarray(smooth.offset_m))


def in_blocks(traces: np.ndarray, valid: np.ndarray, where: Track, block: int) -> LiveScans:
    """A drive fed in blocks; the scans that had to wait for the background have it subtracted when it is known."""
    chain, background = identity_chain(traces.shape[1]), np.zeros(traces.shape[1:], np.float32)
    parts: list[LiveScans] = []
    for low in range(0, len(traces), block):
        some = slice(low, low + block)
        part = chain.feed(traces[some], valid[some], Track(*(field[some] for field in where)), 64)
        if part.background is not None:
            assert not background.any()
            background = part.background
            parts = [each._replace(filtered=each.filtered - each.valid[..., None] * background) for each in parts]
        parts.append(part)

    def whole(name: str) -> np.ndarray:
        return np.concatenate([getattr(part, name) for part in parts])

    assert [part.settled for part in parts] == [part.path_m[-1] >= 2.0 for part in parts]
    travel = whole("path_m"), whole("dead_reckoned_m")
    return LiveScans(whole("number"), whole("filtered"), whole("valid"), where, *travel, background=background)


def test_blocks_give_the_scans_of_the_whole() -> None:
    """Filtered traces, travel and dead reckoning; the vehicle stands for 60 scans on the way, and backs up."""
    travel = np.concatenate([np.arange(100) * 0.05, np.full(60, 4.95), 4.95 - np.arange(1, 101) * 0.03])
    where = track(travel, 0.0 * travel, 0.2 * np.sin(travel), travel)
    rng = np.random.default_rng(1)
    traces, valid = rng.normal(size=(260, 2, SAMPLES)).astype(np.float32), rng.random((260, 2)) > 0.2
    whole = in_blocks(traces, valid, where, 64)
    for block in (23, 1):
        other = in_blocks(traces, valid, where, block)
        for name in ("number", "filtered", "path_m", "dead_reckoned_m", "background"):
            np.testing.assert_allclose(getattr(whole, name), getattr(other, name), atol=1e-5)
    assert whole.number.tolist() == list(range(260))
    assert whole.path_m[-1] == pytest.approx(4.95 + 3.0)
    assert np.all(np.diff(whole.path_m) >= 0.0)
    assert whole.dead_reckoned_m[-1, 0] < whole.dead_reckoned_m[100, 0]


def test_the_first_scans_share_the_mean_over_all_of_them() -> None:
    """Over half the filter's length: the exponential mean, written out, forgets what lies farther back."""
    rng = np.random.default_rng(1)
    traces = (rng.normal(size=(80, 2, SAMPLES)) + 3.0).astype(np.float32)
    valid = rng.random((80, 2)) > 0.2
    scans = in_blocks(traces, valid, straight(80, 0.051), 64)
    assert scans.background is not None
    for channel in range(2):
        ok = np.flatnonzero(valid[:41, channel])
        # The first scan has travelled nothing yet.
        weight = np.exp(-0.051 / 2.0) ** np.arange(len(ok))[::-1] * (ok > 0)
        np.testing.assert_allclose(scans.background[channel], weight @ traces[ok, channel] / weight.sum(), atol=0.01)
        own = scans.filtered[ok, channel]
        np.testing.assert_allclose(own, traces[ok, channel] - scans.background[channel], atol=1e-5)
    assert not scans.filtered[~valid].any()


def test_coefficients_do_not_depend_on_their_neighbours() -> None:
    chain = identity_chain(2)
    filtered = np.random.default_rng(2).normal(size=(40, 2, SAMPLES)).astype(np.float32)
    valid = np.random.default_rng(3).uniform(size=(40, 2)) > 0.2
    whole = chain.coefficients(filtered, valid, 1.0)
    assert whole.shape == (40, 2, SAMPLES)
    for some in (slice(0, 1), slice(3, 20), slice(17, 40)):
        np.testing.assert_allclose(chain.coefficients(filtered[some], valid[some], 1.0), whole[some], atol=1e-6)


def test_what_stays_the_same_is_gone_from_the_first_scan_on() -> None:
    chain, where = identity_chain(1), straight(60, 0.05)
    scans = chain.feed(np.full((60, 1, SAMPLES), 5.0, np.float32), np.ones((60, 1), bool), where, 64)
    np.testing.assert_allclose(scans.filtered, 0.0, atol=1e-5)
