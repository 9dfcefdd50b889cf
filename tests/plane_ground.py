"""Maps of ground drawn in the plane, station by station: drives may go anywhere, labels be wrong by anything."""

from pathlib import Path

import numpy as np

from lgprjax.formats import MapWriter
from lgprjax.frames import LocalFrame
from lgprjax.radar import default_chain
from lgprjax.subsurface import MapDescription, StationBlock, TilePlacer

PITCH_M = 0.127
HEIGHT_M = 0.3
SAMPLES = 120
STEP_M = default_chain(250e6, 0.035).step_m
_CORRELATION_M = 0.2
_WAVES = 400
_NOISE = 0.35  # of the ground's own strength, every drive anew


def write_plane_map(
    path: Path,
    truth: list[np.ndarray],
    label: list[np.ndarray],
    *,
    channels: int = 7,
    seed: int = 0,
    sigma_m: float = 0.5,
) -> None:
    """A database of drives over one plane.

    Args:
        path: to write.
        truth, label: of each drive, poses (east_m, north_m, yaw_rad) of its stations, ``STEP_M`` apart.
        channels: of the array.
        seed: of ground and noise.
        sigma_m: what the drives say of their labels.
    """
    rng = np.random.default_rng(seed)
    wave = rng.normal(size=(2, _WAVES)) / _CORRELATION_M
    phase = rng.uniform(0.0, 2.0 * np.pi, _WAVES)
    strength = (rng.normal(size=(_WAVES, SAMPLES)) * np.sqrt(2.0 / _WAVES)).astype(np.float32)
    left_m = (0.5 * (channels - 1) - np.arange(channels)) * PITCH_M
    settings = default_chain(250e6, 0.035)
    spacing_m = max(4.0, 10.0 * settings.step_m)
    tiles = TilePlacer(spacing_m)
    references: list[float] = []
    with MapWriter.create(path) as writer:
        for number, (true, said) in enumerate(zip(truth, label, strict=True)):
            antenna = true[:, None, :2] + _aside(true[:, 2], left_m)
            heard = np.cos(antenna @ wave + phase).astype(np.float32) @ strength
            heard += _NOISE * rng.standard_normal(heard.shape).astype(np.float32)
            pose = np.zeros((len(said), 5))
            pose[:, [0, 1, 3]], pose[:, 2] = said, HEIGHT_M
            block = StationBlock(
                profile=heard,
                valid=np.ones(heard.shape[:2], bool),
                pose=pose,
                ground_up_m=np.zeros(len(said)),
                antenna_m=np.concatenate(
                    [_aside(said[:, 2], left_m), np.full((len(said), channels, 1), HEIGHT_M)], axis=2
                ),
                time_s=np.arange(len(said)) * 0.01,
            )
            references += [HEIGHT_M] * tiles.place(pose)
            writer.append(block, number)
        description = MapDescription(
            name=path.name,
            frame=LocalFrame(42.0, -71.0, 0.0),
            settings=settings,
            channel_pitch_m=PITCH_M,
            channels=channels,
            tile_spacing_m=spacing_m,
            gain=np.ones(SAMPLES, np.float32),
            label_sigma_m=(sigma_m,) * len(truth),
        )
        inputs = [{"file": f"drive {number}", "position_sigma_m": sigma_m} for number in range(len(truth))]
        writer.finish(description, tiles.frames, np.asarray(references), {"inputs": inputs, "steps": ["drawn"]})


def _aside(yaw_rad: np.ndarray, left_m: np.ndarray) -> np.ndarray:
    """East and north of places to the left of headings."""
    return np.asarray(left_m[None, :, None] * np.stack([-np.sin(yaw_rad), np.cos(yaw_rad)], axis=1)[:, None])
