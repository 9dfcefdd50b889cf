"""The linkage against the geometry of its two arms, and the rear map of two of them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

from lgprjax.vehicle import (
    Linkage,
    largest_shaft_angle,
    largest_wheel_angle,
    rear_angle,
    rear_of_linkages,
    shaft_angle,
    straight_slope,
    wheel_angle,
)

FRONT = Linkage(0.3, 0.4, 0.5)


def test_both_arms_stand_off_their_line_by_the_same_distance() -> None:
    shaft = np.radians(np.linspace(-80.0, 80.0, 33))
    wheel = np.asarray(wheel_angle(FRONT, jnp.asarray(shaft, jnp.float32)), np.float64)
    np.testing.assert_allclose(0.4 * np.sin(wheel), 0.3 * np.sin(0.5 * shaft), atol=1e-7)
    assert (np.sign(wheel) == np.sign(shaft)).all()
    assert float(wheel_angle(FRONT, jnp.float32(1e-3))) / 1e-3 == pytest.approx(straight_slope(FRONT), rel=1e-4)


def test_the_shaft_angle_is_the_root_of_the_wheel_angle() -> None:
    for degrees in (-40.0, -3.0, 0.0, 12.0, 45.0):
        wanted = np.radians(degrees)
        root = brentq(lambda x, to: np.arcsin(0.75 * np.sin(0.5 * x)) - to, -np.pi, np.pi, args=(wanted,), xtol=1e-13)
        assert float(shaft_angle(FRONT, jnp.float32(wanted))) == pytest.approx(root, abs=1e-6)


@pytest.mark.parametrize("linkage", [FRONT, Linkage(0.4, 0.3, 1.5)])
def test_beyond_its_reach_a_linkage_has_no_angle(linkage: Linkage) -> None:
    shaft, wheel = float(largest_shaft_angle(linkage)), float(largest_wheel_angle(linkage))
    # By search: the first shaft angle at which the wheel no longer turns further, or has no angle at all.
    tried = np.linspace(0.0, 1.2 * np.pi, 200_001)
    with np.errstate(invalid="ignore"):
        reached = np.arcsin(linkage.crank_m / linkage.arm_m * np.sin(linkage.gear * tried))
    first = np.flatnonzero(~(np.diff(reached) > 0.0))[0]
    assert shaft == pytest.approx(tried[first], abs=1e-4)
    assert wheel == pytest.approx(reached[first], abs=0.02)
    assert np.isnan(float(shaft_angle(linkage, jnp.float32(wheel + 0.01)))) == (wheel < 1.5)
    assert np.isfinite(float(wheel_angle(linkage, jnp.float32(0.999 * shaft))))


def test_two_arms_in_the_ratio_of_0_6_leave_k_0_582_at_thirty_degrees() -> None:
    front_arm = Linkage(0.5, 0.5, 1.0)
    rear = rear_of_linkages(front_arm, Linkage(0.3, 0.5, 1.0), np.radians(35.0))
    front = np.radians([-30.0, 1.0, 10.0, 20.0, 30.0])
    behind = np.asarray(rear_angle(rear, jnp.asarray(front, jnp.float32))[0], np.float64)
    np.testing.assert_allclose(behind, np.arcsin(0.6 * np.sin(front)), atol=2e-5)
    assert behind[-1] / front[-1] == pytest.approx(0.582, abs=5e-4)
    # A gear of its own bends the rear map.
    geared = rear_of_linkages(front_arm, Linkage(0.3, 0.5, 1.2), 0.5)
    expected = np.arcsin(0.6 * np.sin(1.2 * 0.4))
    assert float(rear_angle(geared, jnp.float32(0.4))[0]) == pytest.approx(expected, abs=2e-5)


def test_a_front_angle_that_a_linkage_does_not_reach_is_refused() -> None:
    with pytest.raises(ValueError, match=r"1\.2"):
        rear_of_linkages(FRONT, Linkage(0.3, 0.5, 1.0), 1.2)


def test_the_derivative_is_that_of_the_angle() -> None:
    slope = float(jax.grad(lambda shaft: wheel_angle(FRONT, shaft))(jnp.float32(0.7)))
    step = 1e-4
    exact = np.arcsin(0.75 * np.sin(0.5 * (0.7 + step))) - np.arcsin(0.75 * np.sin(0.5 * (0.7 - step)))
    assert slope == pytest.approx(exact / (2 * step), rel=1e-5)
