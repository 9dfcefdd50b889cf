"""What registering the days of a world shows: shares, errors, consistency, over the scans that lie over the map."""

import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree
from scipy.stats import chi2

from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions
from validation.worlds.course import centreline_of
from validation.worlds.drives import Drive, days_of, ground_of, write_live, write_passes
from validation.worlds.parameters import World

START_M = 4.0
PIECE_M = 4.0
WRONG_M = 0.3
_WRONG_SIGMAS = 4.0
_COVERED = 0.6


@dataclass(frozen=True)
class DayFigures:
    """One day of one world. Errors are against the truth in the frame of the map's labels, metres.

    Attributes:
        world, day, channels, beyond: which.
        ground_is_mapped: a fix may be right: not so for impostors.
        scans: that count: after the first four metres of travel, over the map.
        ok, wrong: of them; wrong ones of an impostor are all that are ok.
        right: found within 0.3 m along and across, whatever the code.
        largest_along_m, largest_cross_m, rms_along_m, rms_cross_m: of ok fixes; NaN without any.
        pieces: of four metres of travel, begun with an ok fix or not.
        nees: mean normalised squared error of position a degree of freedom, one ok fix a piece, against labels; what
            the map says of its labels is taken off the covariance.
        nees_place: the same against the true place, the labels' own error included.
        nees_pieces: pieces that gave a fix.
        declined: scans by code.
        largest_p_false, median_window_m: of ok fixes, where the table has such columns; NaN where not.
        milliseconds: a scan.
        signal_db: ground over noise at half of the recorded time.
    """

    world: int
    day: str
    channels: int
    beyond: bool
    ground_is_mapped: bool
    scans: int
    ok: int
    wrong: int
    right: int
    largest_along_m: float
    largest_cross_m: float
    rms_along_m: float
    rms_cross_m: float
    pieces: int
    nees: float
    nees_place: float
    nees_pieces: int
    declined: dict[str, int]
    largest_p_false: float
    median_window_m: float
    milliseconds: float
    signal_db: float

    @property
    def ok_share(self) -> float:
        """Of the scans that count; NaN where there are none."""
        return self.ok / self.scans if self.scans else float("nan")


class Judged(NamedTuple):
    """Every scan of a drive against its truth.

    Attributes:
        counts: it has travelled far enough and lies over the map.
        ok: by its code.
        along_m, cross_m: error along and across the true heading, against labels.
        sigma_cross_m: as the fix says.
        normalised, normalised_place: squared errors of position over the covariance, against labels and true place.
        piece: of travel that it belongs to.
    """

    counts: Bool[np.ndarray, " scan"]
    ok: Bool[np.ndarray, " scan"]
    along_m: Float[np.ndarray, " scan"]
    cross_m: Float[np.ndarray, " scan"]
    sigma_cross_m: Float[np.ndarray, " scan"]
    normalised: Float[np.ndarray, " scan"]
    normalised_place: Float[np.ndarray, " scan"]
    piece: np.ndarray


def world_figures(
    world: World,
    days: Sequence[str] | None = None,
    options: RegisterOptions | None = None,
    keep: Path | None = None,
) -> list[DayFigures]:
    """Make a world's drives and map, register its days and judge every fix.

    Args:
        world: which.
        days: by name; those that it has not are left out. Without any, all that it has.
        options: the defaults where none are given.
        keep: folder that drives and maps stay in; they are gone afterwards without.
    """
    options = options or RegisterOptions()
    wanted = [day for day in days_of(world) if days is None or day in days]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) if keep is None else keep / f"world{world.number:02d}"
        return list(_days(world, wanted, options, folder))


def _days(world: World, days: Sequence[str], options: RegisterOptions, folder: Path) -> Iterator[DayFigures]:
    own, line = [day for day in days if day != "lookalike"], centreline_of(world)
    for name, of_map in (("own", own), ("periodic", [day for day in days if day == "lookalike"])):
        if not of_map:
            continue
        place = folder / name
        place.mkdir(parents=True, exist_ok=True)
        # One ground is held at a time: they are the bulk of the memory.
        ground = ground_of(world, line, of_map[0] if name == "periodic" else "clear")
        passes = write_passes(world, ground, place)
        lives = {day: write_live(world, ground, day, place) for day in of_map if day != "impostor"}
        del ground
        if "impostor" in of_map:
            lives["impostor"] = write_live(world, ground_of(world, line, "impostor"), "impostor", place)
        build_map([drive.path for drive in passes], place / "ground.map.h5", force=True)
        for day, live in lives.items():
            with MapFile.open(place / "ground.map.h5") as source, DriveLog.open(live.path) as log:
                registered = register_log(source, log, options)
            yield figures_of(world, day, registered, passes, live)


def judge(world: World, registered: RegisteredDrive, passes: Sequence[Drive], live: Drive) -> Judged:
    """Every scan of a registered drive against the truth that the generator knows."""
    assert registered.truth is not None
    mapped = np.concatenate([drive.motion.antenna_m[..., :2].reshape(-1, 2) for drive in passes])
    labels = np.concatenate([np.repeat(drive.label_error_m, world.channels, axis=0) for drive in passes])
    spacing = max(world.pitch_m, world.scan_spacing_m)
    antennas = live.motion.antenna_m[..., :2]
    away, nearest = cKDTree(mapped).query(antennas, k=8)
    over = np.mean(away[..., 0] < spacing, axis=1) >= _COVERED
    weight = 1.0 / (away**2 + (0.25 * spacing) ** 2)
    label = np.einsum("scn,scnd->sd", weight, labels[nearest]) / weight.sum(axis=(1, 2))[:, None]
    yaw = registered.truth[:, 3]
    pose = np.asarray(registered.fix.pose, dtype=float)
    covariance = np.asarray(registered.fix.covariance, dtype=float)[:, :2, :2]
    # What the map says of its labels is no part of an error against them; beside it is the odometer's, along alone.
    beside = np.nan_to_num(np.asarray(registered.map_odometry_covariance, dtype=float))
    said_m2 = np.linalg.eigvalsh(beside)[:, 0]
    place = pose[:, :2] - registered.truth[:, :2]
    against = place - label
    cos, sin = np.cos(yaw), np.sin(yaw)
    across = np.stack([-sin, cos], axis=-1)
    travel = np.interp(live.motion.scan_time_s, live.motion.time_s, live.motion.travel_m)
    travel = travel - travel[0]
    return Judged(
        counts=(travel >= START_M) & over,
        ok=registered.table["code"].to_numpy() == "ok",
        along_m=cos * against[:, 0] + sin * against[:, 1],
        cross_m=cos * against[:, 1] - sin * against[:, 0],
        sigma_cross_m=np.sqrt(np.einsum("si,sij,sj->s", across, covariance, across)),
        normalised=_normalised(against, covariance - said_m2[:, None, None] * np.eye(2)),
        normalised_place=_normalised(place, covariance),
        piece=np.floor(travel / PIECE_M).astype(int),
    )


def wrong_fixes(judged: Judged) -> Bool[np.ndarray, " scan"]:
    """Fixes called ok that lie more than 0.3 m off along, or across by that and by four of their sigmas."""
    cross = np.abs(judged.cross_m)
    far = (np.abs(judged.along_m) > WRONG_M) | ((cross > WRONG_M) & (cross > _WRONG_SIGMAS * judged.sigma_cross_m))
    # A pose that is not a number is not right.
    return np.asarray(judged.ok & (far | ~np.isfinite(judged.along_m)))


def figures_of(world: World, day: str, registered: RegisteredDrive, passes: Sequence[Drive], live: Drive) -> DayFigures:
    judged = judge(world, registered, passes, live)
    mapped = day != "impostor"
    counts, ok = judged.counts, judged.counts & judged.ok
    wrong = (wrong_fixes(judged) if mapped else judged.ok) & counts
    right = counts & (np.abs(judged.along_m) <= WRONG_M) & (np.abs(judged.cross_m) <= WRONG_M)
    # The last ok fix of each piece.
    last = np.unique(judged.piece[ok][::-1], return_index=True)[1]
    chosen = np.flatnonzero(ok)[::-1][last]
    codes = Counter(registered.table["code"].to_numpy()[counts & ~judged.ok].tolist())

    def of_ok(column: str) -> np.ndarray:
        known = registered.table[column].to_numpy()[ok] if column in registered.table else np.zeros(0)
        return known[np.isfinite(known)]

    def summary(values: np.ndarray, squared: bool) -> float:
        if not len(values):
            return float("nan")
        return float(np.sqrt(np.mean(values**2)) if squared else np.max(np.abs(values)))

    p_false, window_m = of_ok("p_false"), of_ok("window_m")
    return DayFigures(
        world=world.number,
        day=day,
        channels=world.channels,
        beyond=world.beyond,
        ground_is_mapped=mapped,
        scans=int(counts.sum()),
        ok=int(ok.sum()),
        wrong=int(wrong.sum()),
        right=int(right.sum()),
        largest_along_m=summary(judged.along_m[ok], False),
        largest_cross_m=summary(judged.cross_m[ok], False),
        rms_along_m=summary(judged.along_m[ok], True),
        rms_cross_m=summary(judged.cross_m[ok], True),
        pieces=len(np.unique(judged.piece[counts])),
        nees=float(np.mean(judged.normalised[chosen]) / 2.0) if len(chosen) else float("nan"),
        nees_place=float(np.mean(judged.normalised_place[chosen]) / 2.0) if len(chosen) else float("nan"),
        nees_pieces=len(chosen),
        declined=dict(codes),
        largest_p_false=float(p_false.max()) if len(p_false) else float("nan"),
        median_window_m=float(np.median(window_m)) if len(window_m) else float("nan"),
        milliseconds=registered.milliseconds_per_scan,
        signal_db=float(live.recording.signal_db[world.samples // 2]),
    )


def _normalised(
    error_m: Float[np.ndarray, "scan 2"], covariance: Float[np.ndarray, "scan 2 2"]
) -> Float[np.ndarray, " scan"]:
    """Squared errors in units of the covariance; infinite where it is none."""
    (a, b), (c, d) = covariance[:, 0].T, covariance[:, 1].T
    x, y = error_m.T
    determinant = a * d - b * c
    proper = (determinant > 0.0) & (a > 0.0)
    squared = (d * x**2 - (b + c) * x * y + a * y**2) / np.where(proper, determinant, 1.0)
    return np.where(proper, squared, np.inf)


class Pooled(NamedTuple):
    """Normalised squared error over several days: mean a degree of freedom, pieces, and where the mean of a consistent
    filter lies with a probability of 99.9 %."""

    mean: float
    pieces: int
    low: float
    high: float


def pooled_nees(figures: Sequence[DayFigures]) -> Pooled:
    """NEES a degree of freedom against labels, all pieces alike. Without any piece the mean is NaN."""
    pieces = sum(row.nees_pieces for row in figures)
    if not pieces:
        return Pooled(float("nan"), 0, 0.0, float("inf"))
    total = sum(row.nees * row.nees_pieces for row in figures if row.nees_pieces)
    low, high = chi2.ppf([0.0005, 0.9995], 2 * pieces) / (2 * pieces)
    return Pooled(total / pieces, pieces, float(low), float(high))
