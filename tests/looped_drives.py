"""Drives over a course that crosses itself and closes, their label errors, and fixes of one on another: all by hand."""

from typing import NamedTuple

import numpy as np

from lgprjax.navigation.pose_graph import FixEdges, LabelChain

LENGTH_M = 2000.0
STEP_M = 1.0
_BEYOND_M = 150.0  # that each drive goes on after a lap


class LoopedDrives(NamedTuple):
    """Drives at places ``STEP_M`` apart, and the fixes between them.

    Attributes:
        chains: one a drive.
        truth, label: poses (east_m, north_m, yaw_rad) of each drive.
        edges: right fixes.
        ends: place of each fix's two ends in their drives.
    """

    chains: tuple[LabelChain, ...]
    truth: list[np.ndarray]
    label: list[np.ndarray]
    edges: FixEdges
    ends: np.ndarray


def course(at_m: np.ndarray) -> np.ndarray:
    """Pose along a closed course of four leaves, three of which it crosses itself to enter."""
    fine = np.linspace(0.0, 2.0 * np.pi, 40_001)
    radius = 1.0 + 0.9 * np.cos(4.0 * fine) + 0.6 * np.sin(3.0 * fine)
    plane = np.stack([radius * np.cos(fine), radius * np.sin(fine)], axis=1)
    path = np.append(0.0, np.cumsum(np.hypot(*np.diff(plane, axis=0).T)))
    plane *= LENGTH_M / path[-1]
    path *= LENGTH_M / path[-1]
    turn = np.unwrap(np.arctan2(*np.gradient(plane, axis=0).T[::-1]))
    wrapped, laps = np.mod(at_m, LENGTH_M), np.floor(at_m / LENGTH_M)
    yaw = np.interp(wrapped, path, turn) + laps * (turn[-1] - turn[0])
    return np.stack([np.interp(wrapped, path, plane[:, 0]), np.interp(wrapped, path, plane[:, 1]), yaw], axis=1)


def slow_error(rng: np.random.Generator, at_m: np.ndarray, rms: float) -> np.ndarray:
    """A sum of waves of 200 to 900 m, of this root mean square over the drive."""
    wave = 2.0 * np.pi / rng.uniform(200.0, 900.0, 30)
    value = np.cos(at_m[:, None] * wave + rng.uniform(0.0, 2.0 * np.pi, 30)) @ rng.normal(size=30)
    return np.asarray(value * rms / np.sqrt(np.mean(value**2)))


def composed(pose: np.ndarray, relative: np.ndarray) -> np.ndarray:
    """Poses given in the frames of others."""
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    x, y, yaw = relative.T
    return np.stack([pose[:, 0] + cos * x - sin * y, pose[:, 1] + sin * x + cos * y, pose[:, 2] + yaw], axis=1)


def relative_to(pose: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Poses in the frames of others."""
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    x, y, yaw = (other - pose).T
    return np.stack([cos * x + sin * y, cos * y - sin * x, yaw], axis=1)


def looped_drives(seed: int, drives: int = 3, rms_m: float = 0.5, sigma_m: float = 0.02) -> LoopedDrives:
    """Drives of one lap and a little more, every second one the other way, with fixes wherever two passes share ground.

    Args:
        seed: of everything.
        drives: how many.
        rms_m: of the labels' errors, in east and in north.
        sigma_m: of the fixes, on the average.
    """
    rng = np.random.default_rng(seed)
    truth, label, along = [], [], []
    for number in range(drives):
        path = np.arange(0.0, LENGTH_M + _BEYOND_M, STEP_M)
        at = (path if number % 2 == 0 else LENGTH_M - path) + 300.0 * number
        pose = course(at)
        pose[:, 2] += 0.0 if number % 2 == 0 else np.pi
        aside = 0.2 * np.sin(path / 37.0 + number)
        true = composed(pose, np.stack([np.zeros_like(path), aside, np.zeros_like(path)], axis=1))
        wrong = [slow_error(rng, path, rms_m), slow_error(rng, path, rms_m), slow_error(rng, path, np.radians(0.3))]
        truth.append(true)
        label.append(true + np.stack(wrong, axis=1))
        along.append(at)
    chains = tuple(LabelChain(0.0, (len(part) - 1) * STEP_M, 0.5) for part in label)
    ends = _meetings(along)
    edges = fixes_between(rng, truth, label, ends, sigma_m)
    return LoopedDrives(chains, truth, label, edges, ends)


def fixes_between(
    rng: np.random.Generator, truth: list[np.ndarray], label: list[np.ndarray], ends: np.ndarray, sigma_m: float
) -> FixEdges:
    """Fixes of places on the ground of others: [edge, (drive, place, drive, place)]."""
    sigma = rng.uniform(0.5, 1.5, (len(ends), 3)) * [sigma_m, sigma_m, np.radians(0.2)]
    turn = rng.uniform(0.0, np.pi, len(ends))
    axes = np.zeros((len(ends), 3, 3))
    axes[:, 0, 0], axes[:, 0, 1] = np.cos(turn), -np.sin(turn)
    axes[:, 1, 0], axes[:, 1, 1], axes[:, 2, 2] = np.sin(turn), np.cos(turn), 1.0
    true, said = (np.stack([[part[d][p] for d, p in ends[:, k : k + 2]] for k in (0, 2)]) for part in (truth, label))
    found = composed(said[1], relative_to(true[1], true[0]))
    found += np.einsum("eij,ej->ei", axes, sigma * rng.normal(size=sigma.shape))
    return FixEdges(
        chain=ends[:, [0, 2]],
        at_m=ends[:, [1, 3]] * STEP_M,
        label=said.transpose(1, 0, 2),
        found=found,
        covariance=axes @ (sigma[:, :, None] ** 2 * np.eye(3)) @ axes.transpose(0, 2, 1),
    )


def _meetings(along: list[np.ndarray]) -> np.ndarray:
    """Pairs of places at the same ground: later drive on earlier, and each drive's end on its own beginning."""
    rows = []
    for later, mine in enumerate(along):
        for earlier in range(later + 1):
            for place, at in enumerate(mine):
                apart = np.abs(np.mod(along[earlier] - at + 0.5 * LENGTH_M, LENGTH_M) - 0.5 * LENGTH_M)
                if earlier == later:
                    apart[max(0, place - 100) :] = np.inf
                near = int(np.argmin(apart))
                if apart[near] <= 0.5 * STEP_M:
                    rows.append((later, place, earlier, near))
    return np.array(rows)


def with_wrong(
    rng: np.random.Generator, edges: FixEdges, share: float, run: int, shift_m: tuple[float, float]
) -> tuple[FixEdges, np.ndarray]:
    """The edges with a share of them wrong: in runs of neighbours, each run shifted alike; which ones were changed."""
    wrong = np.zeros(len(edges.found), bool)
    found = edges.found.copy()
    while wrong.sum() < share * len(wrong):
        first = int(rng.integers(len(wrong) - run))
        part = np.arange(first, first + run)
        if wrong[part].any() or len(np.unique(edges.chain[part], axis=0)) > 1:
            continue
        angle, size = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(*shift_m)
        found[part, :2] += size * np.array([np.cos(angle), np.sin(angle)])
        wrong[part] = True
    return edges._replace(found=found), wrong
