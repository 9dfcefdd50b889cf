"""Live scans joined to templates: where the antennas of a window stand, which scans close one, what is held."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.radar import ArrayGeometry, CoefficientBasis, uniform_array
from lgprjax.registration.live import LiveChain, LiveScans, Track, templates_of, window_members

SAMPLES = 6


def identity_chain(channels: int, history_m: float) -> LiveChain:
    basis = CoefficientBasis(jnp.ones(SAMPLES), jnp.eye(SAMPLES), jnp.ones(SAMPLES // 2))
    return LiveChain(lambda _: jnp.eye(SAMPLES), basis, track_filter_m=4.0, channels=channels, history_m=history_m)


def track(east: np.ndarray, north: np.ndarray, yaw: np.ndarray, travel: np.ndarray, speed: float = 0.0) -> Track:
    zeros = np.zeros_like(travel)
    pose = np.stack([east, north, zeros, yaw, zeros], axis=1)
    return Track(pose, travel, np.full_like(travel, speed), zeros + 0.01)


def straight(scans: int, step_m: float, speed: float = 0.0) -> Track:
    travel = np.arange(scans) * step_m
    return track(travel, 0.0 * travel, 0.0 * travel, travel, speed)


def feed(chain: LiveChain, where: Track, channels: int, block: int = 256) -> LiveScans:
    rng = np.random.default_rng(0)
    scans = len(where.travel_m)
    traces = rng.normal(size=(scans, channels, SAMPLES)).astype(np.float32)
    held, _ = chain.feed(traces, np.ones((scans, channels), bool), where, block)
    return held


def test_a_window_looks_back_in_equal_steps() -> None:
    array = uniform_array(3, 0.4, x_m=2.0)
    scans = feed(identity_chain(3, 2.0), straight(60, 0.05), 3)
    template = templates_of(scans, np.array([50, 58]), array, window_m=1.0, step_m=0.1)
    offset = np.asarray(template.offset_m).reshape(2, 11, 3, 2)
    np.testing.assert_allclose(
        offset[:, :, :, 0], np.broadcast_to(-0.1 * np.arange(11)[:, None], (2, 11, 3)), atol=1e-6
    )
    np.testing.assert_allclose(offset[:, :, :, 1], np.broadcast_to([0.4, 0.0, -0.4], (2, 11, 3)), atol=1e-6)
    assert np.asarray(template.last_scan).reshape(2, 11, 3)[:, 0].all()
    assert np.asarray(template.last_scan).sum() == 2 * 3
    wanted = scans.coefficients[50 - 2 * np.arange(11)].reshape(33, -1)
    np.testing.assert_array_equal(np.asarray(template.coefficients)[0], wanted)


def test_channels_stand_where_the_vehicle_had_come() -> None:
    """The last of four channels is switched on 0.75 of a period late: 3.75 cm farther on at 5 m/s."""
    array = uniform_array(4, 0.1, scan_period_s=0.01)
    scans = feed(identity_chain(4, 0.0), straight(5, 0.05, speed=5.0), 4)
    offset = np.asarray(templates_of(scans, np.array([4]), array, window_m=0.0, step_m=0.1).offset_m)[0]
    np.testing.assert_allclose(offset[:, 0], [0.0, 0.0125, 0.025, 0.0375], atol=1e-6)
    backwards = feed(identity_chain(4, 0.0), straight(5, -0.05, speed=-5.0), 4)
    offset = np.asarray(templates_of(backwards, np.array([4]), array, window_m=0.0, step_m=0.1).offset_m)[0]
    np.testing.assert_allclose(offset[:, 0], [0.0, -0.0125, -0.025, -0.0375], atol=1e-6)


def test_a_window_bends_with_the_road() -> None:
    """Rear axle on a circle of 20 m, array 3 m ahead and 0.2 m to the left: every antenna by hand."""
    radius, ahead, aside = 20.0, 3.0, 0.2
    travel = np.arange(120) * 0.05
    yaw = travel / radius
    array = ArrayGeometry(np.array([ahead, ahead]), np.array([aside + 0.5, aside - 0.5]), np.zeros(2), 0.3)
    axle = np.stack([radius * np.sin(yaw), radius * (1 - np.cos(yaw))], axis=1)

    def antenna(scan: int, y: float) -> np.ndarray:
        c, s = np.cos(yaw[scan]), np.sin(yaw[scan])
        return np.asarray(axle[scan] + [c * ahead - s * y, s * ahead + c * y])

    centre = np.array([antenna(scan, aside) for scan in range(120)])
    scans = feed(identity_chain(2, 5.0), track(centre[:, 0], centre[:, 1], yaw, travel), 2)
    offset = np.asarray(templates_of(scans, np.array([110]), array, window_m=4.0, step_m=0.1).offset_m)[0]
    c, s = np.cos(yaw[110]), np.sin(yaw[110])
    for station in (0, 10, 25, 39):
        for channel, y in enumerate((aside + 0.5, aside - 0.5)):
            apart = antenna(110 - 2 * station, y) - centre[110]
            by_hand = [c * apart[0] + s * apart[1], c * apart[1] - s * apart[0]]
            np.testing.assert_allclose(offset[2 * station + channel], by_hand, atol=6e-3)


def test_gnss_jumps_do_not_bend_a_window() -> None:
    where = straight(60, 0.05)
    jumped = where.pose.copy()
    jumped[30:, :2] += [3.0, -2.0]
    array = uniform_array(3, 0.4)
    smooth = templates_of(feed(identity_chain(3, 2.0), where, 3), np.array([50]), array, window_m=2.0, step_m=0.1)
    scans = feed(identity_chain(3, 2.0), where._replace(pose=jumped), 3)
    after = templates_of(scans, np.array([50]), array, window_m=2.0, step_m=0.1)
    np.testing.assert_array_equal(np.asarray(after.offset_m), np.asarray(smooth.offset_m))


def test_windows_share_the_steps_of_the_path() -> None:
    """The last scan, then the scans at whole steps of the path behind it, none farther back than the window is long."""
    scans = feed(identity_chain(1, 5.0), straight(200, 0.03), 1)
    at = np.array([150, 151, 152])
    member = window_members(scans, at, window_m=2.0, step_m=0.12)
    np.testing.assert_array_equal(member[:, 0], at)
    back_m = scans.path_m[at][:, None] - scans.path_m[member[:, 1:]]
    assert back_m.min() >= 0.06 - 1e-6
    assert 1.9 <= back_m.max() <= 2.06 + 1e-6
    steps = scans.path_m[member[:, 1:]] / 0.12
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    np.testing.assert_allclose(-np.diff(scans.path_m[member[:, 1:]], axis=1), 0.12, atol=1e-6)
    # One more scan moves the window by a whole step or not at all.
    assert set(np.unique(member[1:, 1:] - member[:-1, 1:])) <= {0, 4}


def test_blocks_give_the_windows_of_the_whole() -> None:
    travel = np.concatenate([np.arange(100) * 0.05, np.full(60, 4.95), 4.95 + np.arange(1, 101) * 0.05])
    zero = np.zeros_like(travel)
    where = track(travel, zero, zero, travel)  # it stands for 60 scans on the way
    rng = np.random.default_rng(1)
    traces = rng.normal(size=(260, 2, SAMPLES)).astype(np.float32)
    array = uniform_array(2, 0.3)

    def windows(size: int) -> dict[int, np.ndarray]:
        chain, found = identity_chain(2, 5.0), {}
        for low in range(0, 260, size):
            part = Track(*(field[low : low + size] for field in where))
            valid = np.ones((len(part.travel_m), 2), bool)
            scans, first = chain.feed(traces[low : low + size], valid, part, 64)
            for end in first + np.flatnonzero(scans.path_m[first:] >= 4.0):
                template = templates_of(scans, np.array([end]), array, window_m=4.0, step_m=0.1)
                found[int(scans.number[end])] = np.asarray(template.coefficients)[0]
        return found

    whole, pieces = windows(64), windows(23)
    assert whole.keys() == pieces.keys()
    for number, coefficients in whole.items():
        np.testing.assert_allclose(pieces[number], coefficients, atol=1e-5)


def test_standing_does_not_fill_the_memory() -> None:
    chain = identity_chain(1, 2.0)
    feed(chain, straight(60, 0.05), 1)
    here, zero = np.full(256, 2.95), np.zeros(256)
    for _ in range(5):
        held = feed(chain, track(here, zero, zero, here), 1)
    assert len(held.number) < 60 + 256 + 5


@pytest.mark.parametrize("reverse", [False, True])
def test_a_window_in_reverse_reads_the_path_back(reverse: bool) -> None:
    """Backing up, the path behind the template lies ahead of the vehicle."""
    step = -0.05 if reverse else 0.05
    scans = feed(identity_chain(1, 3.0), straight(60, step), 1)
    offset = np.asarray(templates_of(scans, np.array([58]), uniform_array(1, 0.1), window_m=1.0, step_m=0.1).offset_m)
    np.testing.assert_allclose(offset[0, :, 0], (0.1 if reverse else -0.1) * np.arange(11), atol=1e-6)
