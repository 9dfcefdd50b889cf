"""A record of a worked field made of numbers that a test can foresee."""

import numpy as np

from lgprjax.coverage import Tool
from lgprjax.formats import WorkedRecord
from lgprjax.formats.worked import CoverChannels, CoverEvents, CoverPasses, CoverStops, CoverSwaths, WorkedCells
from lgprjax.frames import LocalFrame

CELL_M = 0.25
LEVELS = (0.95, 0.996)


def made_record(*, empty: bool = False, yaw_rad: float = 0.0, seed: int = 0) -> WorkedRecord:
    """A rectangle of 6 x 4 m, turned, in a grid with a metre around it.

    Its western half has probability 1, the eastern one random numbers with islands and holes; ``empty``: nothing at all
    was worked.
    """
    rng = np.random.default_rng(seed)
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    perimeter = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]]) @ np.array([[cos, sin], [-sin, cos]])
    low, high = np.floor(perimeter.min(axis=0) - 1.0), np.ceil(perimeter.max(axis=0) + 1.0)
    east_cells, north_cells = (round(float(each) / CELL_M) for each in high - low)
    probability = rng.integers(0, 65536, (north_cells, east_cells)).astype(np.uint16)
    # Of random cells half would be far below any level: most of them are raised.
    probability[rng.random(probability.shape) < 0.6] = 65535
    probability[:, : east_cells // 2] = 65535
    if empty:
        probability[:] = 0
    states = [np.where(p >= level, 2, np.where(p < 1 - level, 0, 1)) for level in LEVELS for p in [probability / 65535]]
    count, passes = 40, 0 if empty else 2
    stops, events = (0, 0) if empty else (1, 2)
    return WorkedRecord(
        name="made",
        frame=LocalFrame(-20.5, 30.25, 900.0),
        perimeter_m=perimeter,
        tool=Tool(1.0, 0.3, 0.8, 0.0),
        t0_utc="2026-03-01T10:00:00+00:00",
        cells=WorkedCells(
            float(low[0]), float(low[1]), CELL_M, probability, np.array(LEVELS), np.stack(states).astype(np.uint8)
        ),
        channels=CoverChannels(
            time_s=0.1 * np.arange(count),
            run=np.zeros(count, np.uint16),
            x_m=np.linspace(0.0, 5.0, count),
            y_m=np.full(count, 0.5),
            yaw_rad=np.zeros(count),
            covariance=np.tile(1e-4 * np.eye(3, dtype=np.float32), (count, 1, 1)),
            speed_mps=np.full(count, 0.4, np.float32),
            left_mps=np.full(count, 0.4, np.float32),
            right_mps=np.full(count, 0.4, np.float32),
            tool=np.full(count, 0 if empty else 15, np.uint8),
            depth_m=np.full(count, 0.15, np.float32),
            mode=np.full(count, 5, np.uint8),
            line=np.zeros(count, np.int32),
            stop=np.zeros(count, np.uint16),
            gnss_quality=np.full(count, 3, np.uint8),
        ),
        passes=CoverPasses(
            np.zeros(passes, np.uint16),
            np.arange(passes, dtype=np.int32),
            *(np.linspace(1.0, 2.0, passes) for _ in range(2)),
            *(np.full(passes, value) for value in (5.0, 1.0, 0.15, 0.14, 0.4, 0.45)),
        ),
        swaths=CoverSwaths(
            np.repeat(np.arange(passes, dtype=np.uint32), 2),
            np.tile([0.0, 5.0], passes),
            np.repeat(0.5 + np.arange(passes, dtype=np.float64), 2),
        ),
        stops=CoverStops(
            np.zeros(stops, np.uint16),
            np.full(stops, 1.5),
            np.full(stops, 3.0),
            np.full(stops, 2.0),
            np.full(stops, 0.5),
            np.full(stops, 4, np.uint16),
        ),
        events=CoverEvents(
            np.zeros(events, np.uint16),
            np.linspace(0.0, 3.0, events),
            np.linspace(0.0, 4.0, events),
            np.full(events, 0.5),
            ('{"event": "speed_engaged"}', '{"event": "ruhe, Ä <b>"}')[:events],
        ),
        provenance={
            "program": "lgprjax",
            "plan": {"file": "p.cover.geojson", "sha256": "cd" * 32},
            "other_plans": [],
            "vehicle": {"name": "flail", "sha256": "ef" * 32},
            "runs": [
                {
                    "run": "u",
                    "folder": "run <1>",
                    "complete": False,
                    "segments": [{"file": "0000.lgprun", "sha256": "01" * 32}],
                }
            ],
        },
    )
