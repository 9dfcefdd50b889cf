"""Scatter of labels, told by five baselines of which each in turn is left out."""

from pathlib import Path

import numpy as np
import pytest

from lgprjax.batch.chance import measure_chance
from lgprjax.formats import MapFile
from plane_ground import STEP_M, write_plane_map


def test_left_out_baselines_tell_the_scatter_of_labels(tmp_path: Path) -> None:
    """Five drives over one another, each of whose labels is off by a vector of its own."""
    along = np.arange(0.0, 20.0, STEP_M)
    offset = 0.08 * np.random.default_rng(8).standard_normal((5, 2))
    truth = [np.stack([along, np.full_like(along, 0.1 * n), np.zeros_like(along)], axis=1) for n in range(5)]
    label = [pose + [*off, 0.0] for pose, off in zip(truth, offset, strict=True)]
    write_plane_map(tmp_path / "a.map.h5", truth, label, sigma_m=0.05)
    with MapFile.open(tmp_path / "a.map.h5") as source:
        found = measure_chance(source).label_scatter_m
    # Of each and the mean of the others: the sample's own standard deviation.
    true = float(np.sqrt(np.mean(np.var(offset, axis=0, ddof=1))))
    assert found == pytest.approx(true, rel=0.35, abs=0.015)
