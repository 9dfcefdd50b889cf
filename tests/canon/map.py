"""Small maps of made-up ground: a bent road, driven once and again beside, written as a database."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from lgprjax.formats import MapFile, MapPrecision, MapWriter
from lgprjax.frames import LocalFrame
from lgprjax.mapping import build_map
from lgprjax.radar import ChainSettings, default_chain
from lgprjax.registration import Chance, pooled_chance
from lgprjax.subsurface import MapDescription, StationBlock, TilePlacer

CHANNELS, SAMPLES, PITCH_M = 5, 40, 0.127
SETTINGS: ChainSettings = default_chain(250e6, 0.036)
GAIN = np.linspace(1.0, 3.0, SAMPLES, dtype=np.float32)


def made_stations(stations: int, seed: int, aside_m: float = 0.0) -> StationBlock:
    """Stations along a bent road, ``aside_m`` left of its middle; channel 1 is absent from some."""
    rng = np.random.default_rng(seed)
    travel = np.arange(stations) * SETTINGS.step_m
    yaw = 0.4 * np.sin(travel / 20.0)
    east, north = np.cumsum(SETTINGS.step_m * np.cos(yaw)), np.cumsum(SETTINGS.step_m * np.sin(yaw))
    pose = np.stack(
        [east - aside_m * np.sin(yaw), north + aside_m * np.cos(yaw), 0.3 + 0.01 * np.sin(travel), yaw, 0.02 * yaw], 1
    )
    left = (CHANNELS // 2 - np.arange(CHANNELS)) * PITCH_M
    offset = np.stack([-np.sin(yaw[:, None]) * left, np.cos(yaw[:, None]) * left], axis=-1)
    up = pose[:, 2:3] + left * np.sin(pose[:, 4:5])
    place = pose[:, None, :2] + offset
    depth = np.arange(SAMPLES)
    phase = 0.9 * depth + 4.0 * place[..., :1] + 3.0 * place[..., 1:]
    profile = (np.cos(phase) + 0.3 * rng.standard_normal(phase.shape)) * np.exp(-depth / 20.0)
    valid = np.ones((stations, CHANNELS), bool)
    valid[50:60, 1] = False
    profile[~valid] = 0.0
    antenna_m = np.concatenate([offset, up[..., None]], axis=-1)
    return StationBlock(profile.astype(np.float32), valid, pose, 0.02 * travel, antenna_m, 0.01 * np.arange(stations))


def write_made_map(
    path: Path, precision: MapPrecision, stations: int = 1500, weight: tuple[float, ...] = ()
) -> list[StationBlock]:
    """Two baselines, appended in uneven parts; the first with a weight of its own where weights are given."""
    baselines = [made_stations(stations, 1), made_stations(stations, 2, aside_m=0.5)]
    placer = TilePlacer(4.0)
    with MapWriter.create(path, precision=precision) as writer:
        for number, block in enumerate(baselines):
            for low, high in pairwise(sorted({0, 100, min(700, stations), stations})):
                writer.append(StationBlock(*(field[low:high] for field in block)), number)
            placer.place(block.pose)
        description = MapDescription(
            "made", LocalFrame(42.0, -71.0, 0.0), SETTINGS, PITCH_M, CHANNELS, 4.0, GAIN, (0.0, 0.0), weight
        )
        writer.finish(description, placer.frames, np.full(len(placer.frames), 0.3), {"inputs": []})
    return baselines


def of_many_grounds(source: MapFile) -> Chance:
    """False-match statistics of many grounds in place of the map's own, whose measurement takes minutes."""
    return pooled_chance(source.description.settings.wavelength_m)


@contextmanager
def built_with_many_grounds() -> Iterator[None]:
    """Commands and ``lx`` build maps with false-match statistics of many grounds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lgprjax.mapping.build_map", partial(build_map, measure=of_many_grounds))
        yield
