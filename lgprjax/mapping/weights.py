"""Weights of a map's baselines where several cover the same ground: by age, agreement and signal.

Two baselines that receive the same ground g with independent noise, rho_a g + sqrt(1 - rho_a²) n_a each in units of its
own RMS, correlate by rho_a rho_b. From the matches of pairs the rho of each follows (least squares of the logarithms),
and the best mean weighs a baseline by rho / (1 - rho²). For a baseline without another nearby, the share of its own
signal that repeats along the track is used as rho². Ground ages: a baseline loses half of its weight in a year.
"""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

HALF_LIFE_DAYS = 365.0
"""Frost, roots, repairs and moisture change ground within years; one season hardly matters."""

_LEAST = 0.05  # ground covered by one baseline must not vanish in rounding, and no drive may dominate a map
_RHO = (0.3, 0.97)
_RIDGE = 1e-3  # two baselines alone cannot separate their noise: they share it


class BaselineWeight(NamedTuple):
    """Weight of one baseline's traces, the best one's being 1, and the reasons in words."""

    weight: float
    reasons: str


def weigh_baselines(
    recorded: Sequence[datetime | None],
    agreement: Float[np.ndarray, "drive drive"],
    repeats: Float[np.ndarray, " drive"],
) -> tuple[BaselineWeight, ...]:
    """Weights of all baselines of a map.

    Args:
        recorded: recording time; ``None`` if unknown.
        agreement: median score of the matches between two baselines, NaN if they do not overlap; the diagonal does not
            count.
        repeats: share of each baseline's signal that repeats an eighth of a wavelength farther; NaN if unknown.
    """
    age, age_words = _by_age(recorded)
    ground, ground_words = _by_ground(agreement, repeats)
    whole = np.maximum(age * ground, 1e-9)
    weight = np.maximum(whole / whole.max(), _LEAST)
    return tuple(
        BaselineWeight(round(float(w), 4), f"{a}; {g}") for w, a, g in zip(weight, age_words, ground_words, strict=True)
    )


def moment_of(text: object) -> datetime | None:
    """Moment of an ISO 8601 text, UTC without a zone; None if it is invalid."""
    try:
        moment = datetime.fromisoformat(str(text))
    except ValueError:
        return None
    return moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)


def newer_than(recorded: Sequence[datetime | None]) -> np.ndarray:
    """Which drive (row) was recorded later than which (column); False where either date is not known."""
    return np.array([[a is not None and b is not None and a > b for b in recorded] for a in recorded], bool)


def _by_age(recorded: Sequence[datetime | None]) -> tuple[Float[np.ndarray, " drive"], list[str]]:
    known = [moment for moment in recorded if moment is not None]
    factor, words = np.ones(len(recorded)), []
    for number, moment in enumerate(recorded):
        if moment is None:
            words.append("age unknown")
            continue
        days = (max(known) - moment).total_seconds() / 86400.0
        factor[number] = 0.5 ** (days / HALF_LIFE_DAYS)
        words.append(f"{days:.0f} days older than the newest: {factor[number]:.2f}")
    return factor, words


def _by_ground(
    agreement: Float[np.ndarray, "drive drive"], repeats: Float[np.ndarray, " drive"]
) -> tuple[Float[np.ndarray, " drive"], list[str]]:
    count = len(agreement)
    first, second = np.nonzero(np.triu(np.isfinite(agreement), 1))
    beside = np.bincount(np.concatenate([first, second]), minlength=count)
    log_rho = np.full(count, np.nan)
    if len(first):
        rows = np.zeros((len(first), count))
        rows[np.arange(len(first)), first] = rows[np.arange(len(first)), second] = 1.0
        right = np.log(np.clip(agreement[first, second], _RHO[0] ** 2, 1.0))
        # Each is regularised slightly by the common mean: half of the mean logarithm.
        lean = np.full(count, 0.5 * float(right.mean()))
        solved = np.linalg.solve(rows.T @ rows + _RIDGE * np.eye(count), rows.T @ right + _RIDGE * lean)
        log_rho = np.where(beside > 0, solved, np.nan)
    rho = np.where(beside > 0, np.exp(log_rho), np.sqrt(np.clip(repeats, 0.0, 1.0)))
    known = np.isfinite(rho)
    rho = np.clip(np.where(known, rho, np.median(rho[known]) if known.any() else _RHO[1]), *_RHO)
    factor = rho / (1.0 - rho**2)
    factor = factor / factor.max()
    words = []
    for number in range(count):
        if beside[number]:
            what = f"share of ground in its signal, from {beside[number]} other drive(s): {rho[number] ** 2:.2f}"
        elif known[number]:
            what = f"no other drive nearby, share repeated along the track: {rho[number] ** 2:.2f}"
        else:
            what = "no other drive nearby, signal unknown"
        words.append(f"{what}: {factor[number]:.2f}")
    return factor, words


# Results of updates: returned to the caller, and kept in the map's provenance.


class UpdateStretch(NamedTuple):
    """Ground on which a new drive does not match an old baseline.

    Attributes:
        start_m, stop_m: start and end along the new drive.
        start, stop: latitude_deg and longitude_deg of its ends.
        baseline: number of the old baseline.
        score, usual: score of the matches there, and usual score of the new drive's matches.
        agreeing: newer baselines that agree with the drive: the old one's stations there are retired. Without any the
            ground is changed or disturbed, and the old stations stay in force.
    """

    start_m: float
    stop_m: float
    start: tuple[float, float]
    stop: tuple[float, float]
    baseline: int
    score: float
    usual: float
    agreeing: tuple[int, ...]


class DriveUpdate(NamedTuple):
    """Effect of one drive on a map.

    Attributes:
        number: number of the update, from 1 on.
        name: name of the drive.
        baseline: number of the drive in the map.
        map_sha256: SHA-256 of the map before the update.
        length_m, over_map_m, located_m: length of the drive, on the map's ground, and where fixes agree with their
            neighbours.
        ok_share: share of ok fixes among the scans over the map's ground.
        corrected_m: length of the drive with corrected labels.
        moved_rms_m, moved_max_m: RMS and largest correction.
        match_sigma_m: standard deviation of the corrected labels relative to the map's ground.
        label_sigma_m: standard deviation of the new baseline's labels, as stored in the map.
        stations, held_back: number of stations of the drive, and of those not in force: until a second drive agrees, or
            not located.
        retired, released: number of stations of older baselines taken out of force, and brought back.
        changed: stretches that do not match.
    """

    number: int
    name: str
    baseline: int
    map_sha256: str
    length_m: float
    over_map_m: float
    located_m: float
    ok_share: float
    corrected_m: float
    moved_rms_m: float
    moved_max_m: float
    match_sigma_m: float
    label_sigma_m: float
    stations: int
    held_back: int
    retired: int
    released: int
    changed: tuple[UpdateStretch, ...]


class UpdatedMap(NamedTuple):
    """Result of an update: drive by drive, and the resulting weights of all baselines, with their files."""

    drives: tuple[DriveUpdate, ...]
    weights: tuple[BaselineWeight, ...]
    files: tuple[str, ...]

    def as_json(self) -> dict[str, object]:
        """Plain values, for JSON."""
        weights = [
            {"baseline": number, "file": file, **weight._asdict()}
            for number, (file, weight) in enumerate(zip(self.files, self.weights, strict=True))
        ]
        return {"drives": [plain(drive) for drive in self.drives], "weights": weights}


def changes_in_words(drive: DriveUpdate, files: tuple[str, ...]) -> list[str]:
    """Ground that a drive found changed, a line each; ``files`` are those of the baselines."""
    lines = []
    for each in drive.changed:
        where = f"{each.start_m:.1f} to {each.stop_m:.1f} m ({each.start[0]:.7f}, {each.start[1]:.7f})"
        against = f"against {files[each.baseline]} (matches {each.score:.2f}, usual {each.usual:.2f})"
        if each.agreeing:
            with_it = ", ".join(files[number] for number in each.agreeing)
            lines.append(f"{where}: changed, {against}; {with_it} agrees: the old ground is retired")
        else:
            lines.append(f"{where}: changed or disturbed, {against}; nothing is retired")
    return lines


def plain(value: Any) -> Any:
    """Named tuples as tables, non-finite numbers as null, for JSON."""
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return {name: plain(part) for name, part in value._asdict().items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, np.ndarray):
        return [plain(part) for part in value.tolist()]
    if isinstance(value, float):
        return round(value, 6) if np.isfinite(value) else None
    return value


def file_of(row: dict[str, Any], number: int) -> str:
    """Name of a baseline's file, or its number."""
    return str(row.get("file") or f"baseline {number}").removesuffix(".drive.h5")


def drive_name(path: str | Path) -> str:
    """Name of a drive."""
    return Path(path).name.removesuffix(".drive.h5")
