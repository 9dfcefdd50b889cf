"""The label process at nodes against its covariance function, written out densely."""

import numpy as np
import pytest

from lgprjax.navigation.pose_graph import LabelChain, LabelModel, lay_nodes, noise, place_rows, prior_rows, transition

_SMOOTH = LabelModel(walk_m=0.0, walk_yaw_rad=0.0)
_CHAINS = (LabelChain(10.0, 47.0, 0.5), LabelChain(5.0, 5.3, 0.2), LabelChain(0.0, 30.0, 1.0))


def covariance(apart_m: np.ndarray, sigma: float, length_m: float) -> np.ndarray:
    """Matérn 3/2."""
    d = np.sqrt(3.0) * np.abs(apart_m) / length_m
    return np.asarray(sigma**2 * (1.0 + d) * np.exp(-d))


def test_nodes_reach_from_end_to_end_of_every_chain() -> None:
    nodes = lay_nodes(_CHAINS, LabelModel())
    for number, chain in enumerate(_CHAINS):
        own = nodes.at_m[nodes.first[number] : nodes.first[number + 1]]
        assert np.all(nodes.chain[nodes.first[number] : nodes.first[number + 1]] == number)
        assert own[0] == chain.start_m
        assert own[-1] >= chain.stop_m
        assert len(own) >= 2
        assert np.all((np.diff(own) > 0.9) & (np.diff(own) <= 2.0 + 1e-9))


def test_places_have_the_covariance_of_the_process() -> None:
    """Prior and interpolation together: whatever places are asked for, between nodes or on them."""
    nodes = lay_nodes(_CHAINS, _SMOOTH)
    prior = prior_rows(nodes, _SMOOTH).toarray()
    chain = np.array([0, 0, 0, 0, 1, 2, 2])
    at_m = np.array([10.0, 11.3, 30.0, 46.9, 5.1, 0.7, 29.0])
    rows = place_rows(nodes, chain, at_m, _SMOOTH).toarray()
    dense = rows @ np.linalg.inv(prior.T @ prior) @ rows.T
    for axis in range(3):
        for i in range(len(chain)):
            for j in range(len(chain)):
                sigma = _SMOOTH.sigma_yaw_rad if axis == 2 else _CHAINS[chain[i]].sigma_m
                expected = covariance(at_m[i] - at_m[j], sigma, _SMOOTH.length_m) if chain[i] == chain[j] else 0.0
                # What lies between nodes is given as its mean: it lacks what the nodes do not tell.
                lost = 1e-5 * sigma**2
                assert dense[3 * i + axis, 3 * j + axis] == pytest.approx(float(expected), abs=lost)
                assert dense[3 * i + axis, 3 * j + (axis + 1) % 3] == pytest.approx(0.0, abs=1e-9)


def test_a_place_on_a_node_is_the_node_and_beyond_the_end_is_the_end() -> None:
    model = LabelModel()
    nodes = lay_nodes(_CHAINS, model)
    state = np.random.default_rng(1).normal(size=6 * len(nodes.at_m))
    values = state.reshape(-1, 3, 2)[:, :, 0]
    on = place_rows(nodes, nodes.chain, nodes.at_m, model) @ state
    np.testing.assert_allclose(on.reshape(-1, 3), values, atol=1e-9)
    beyond = place_rows(nodes, np.array([0, 2]), np.array([-3.0, 99.0]), model) @ state
    np.testing.assert_allclose(beyond.reshape(-1, 3), values[[0, -1]], atol=1e-9)


def test_two_gaps_are_one() -> None:
    gap = np.array([3.0])
    twice = transition(gap, _SMOOTH) @ transition(gap, _SMOOTH)
    np.testing.assert_allclose(twice, transition(2.0 * gap, _SMOOTH), rtol=1e-12)
    follow = transition(gap, _SMOOTH)
    added = follow @ noise(gap, np.array([0.5]), 0.0, _SMOOTH) @ follow.transpose(0, 2, 1)
    added = added + noise(gap, np.array([0.5]), 0.0, _SMOOTH)
    np.testing.assert_allclose(added, noise(2.0 * gap, np.array([0.5]), 0.0, _SMOOTH), atol=1e-14)


def test_the_walk_adds_its_variance_by_the_metre() -> None:
    gap = np.array([2.0])
    with_walk = noise(gap, np.array([0.5]), 0.01, LabelModel()) - noise(gap, np.array([0.5]), 0.0, LabelModel())
    np.testing.assert_allclose(with_walk, [[[2e-4, 0.0], [0.0, 0.0]]], atol=1e-15)
