"""Start position of a drive on a map, without a prior position: the host part of the search over the whole map."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from lgprjax.errors import ArgumentError
from lgprjax.files import make_folder
from lgprjax.formats import DriveLog, MapFile, atomic_output
from lgprjax.radar import ArrayGeometry, air_delay_ns, centre_of, shift_travel_time
from lgprjax.recordings.drives import live_operators, recording_of, track_of_drive
from lgprjax.registration import RegisterOptions, ground_map_for
from lgprjax.registration.bayes import Likelihood, anywhere, measure_likelihood
from lgprjax.registration.bayes.drive import SPACING, first_of_each
from lgprjax.registration.queries import rotation
from lgprjax.registration.search import BLOCK_SCANS, live_chain

RISK = 1e-6
"""Largest accepted probability that a start is false."""
MOST_M = 20.0
"""Travel after which a start is abandoned."""
COLUMNS = (
    "start_scan",
    "scan",
    "driven_m",
    "latitude_deg",
    "longitude_deg",
    "heading_deg",
    "sigma_along_m",
    "sigma_cross_m",
    "p_false",
    "hypotheses",
    "code",
)
_COMPONENTS = 32
_PLACES = 128
_CHUNK = 16
_CELLS = 2048
_WANDER_M = 0.03  # of the place on a line, per root of a metre: odometer, and lines that are not parallel
_LOST, _OFF_MAP, _OFF_MAP_M = 0.5, 0.99, 5.0
_AGAIN_M = 4.0
"""Travel after which places are proposed again, if foreign ground is more likely than all proposed ones."""
_LIKELY = 1e-3
_LEAST_EVERY_M = 0.1
_UNSEEN = 0.1  # of the wavelength
_STRETCHES, _BESIDE = 60, 40
_SEED = 2
_FINE = 0.2  # of the wavelength; channels farther apart get a node between them
_MOST_STEP_M = 0.12  # of cells and nodes, as 0.3 m aside is another place


class _Own(NamedTuple):
    """A drive's stops at the nodes of its array, see ``anywhere.Heard``, with their scan numbers, travel and leg."""

    heard: anywhere.Heard
    scan: Int[np.ndarray, " stop"]
    path_m: Float[np.ndarray, " stop"]
    leg: Int[np.ndarray, " stop"]


class MapLines:
    """The map as lines of cells, for drives that begin anywhere.

    Args:
        source: the map; must stay open.
    """

    def __init__(self, source: MapFile) -> None:
        self.source = source
        self.ground = ground_map_for(source, RegisterOptions())
        description = source.description
        self.wavelength_m = description.settings.wavelength_m
        self.spacing_m = min(SPACING * self.wavelength_m, _MOST_STEP_M)
        pitch_m = description.channel_pitch_m
        self._between = description.channels > 1 and pitch_m > min(_FINE * self.wavelength_m, _MOST_STEP_M)
        self.node_m = 0.5 * pitch_m if self._between else pitch_m
        self._components = np.asarray(self.ground.components[:, :_COMPONENTS])
        self.lines, self.origin_m = self._read()
        self._likelihoods: dict[int, Likelihood] = {}

    def _read(self) -> tuple[anywhere.Lines, Float[np.ndarray, "2"]]:
        """Every baseline at steps of the spacing, the nodes from left to right of its array."""
        pose, drive = self.source.pose, self.source.drive
        origin_m = np.asarray(pose[0, :2], np.float64)
        value, known, place = [], [], []
        channels = self.source.description.channels
        nodes = 2 * channels - 1 if self._between else channels
        kept = self._components.shape[1]
        blank = np.zeros((anywhere.HALO, nodes, kept), np.float32)
        for number in np.unique(drive):
            own = np.flatnonzero(drive == number)
            step_m = np.hypot(*np.diff(pose[own, :2], axis=0, prepend=pose[own[:1], :2]).T)
            breaks = np.flatnonzero(step_m > 4.0 * self.spacing_m)
            for part in np.split(np.arange(len(own)), breaks):
                path_m = np.cumsum(np.where(np.arange(len(part)) == 0, 0.0, step_m[part]))
                wanted = np.arange(0.0, path_m[-1] + 1e-9, self.spacing_m)
                nearest = np.unique(own[part[np.searchsorted(path_m, wanted - 1e-9).clip(0, len(part) - 1)]])
                read = self.ground.levelling.read(nearest)
                left = np.einsum(
                    "scx,sx->sc",
                    read.place_m - read.place_m.mean(axis=1, keepdims=True),
                    np.stack([-np.sin(read.yaw_rad), np.cos(read.yaw_rad)], axis=-1),
                )
                order = np.argsort(np.median(left, axis=0))
                traces = read.coefficients[:, order] @ self._components
                there = (read.weight[:, order] > 0.0).astype(np.float32)
                value += [blank, self._noded(traces)]
                known += [blank[..., 0], np.floor(self._noded(there))]
                value, known = [*value, blank], [*known, blank[..., 0]]
                line = np.column_stack([read.place_m.mean(axis=1) - origin_m, np.unwrap(read.yaw_rad)])
                place += [self._beyond(line[0], -1), line, self._beyond(line[-1], 1)]
        joined = np.concatenate(value) * np.concatenate(known)[..., None]
        fields = (joined, np.sum(joined**2, axis=-1), np.concatenate(known), np.concatenate(place))
        # Maps of about one length share their programs.
        more = -len(joined) % _CELLS
        padded = (np.pad(field, [(0, more), *[(0, 0)] * (field.ndim - 1)]) for field in fields)
        return anywhere.Lines(*(jnp.asarray(field, jnp.float32) for field in padded)), origin_m

    def _beyond(self, end: Float[np.ndarray, "3"], way: int) -> Float[np.ndarray, "cell 3"]:
        """Poses of the unmapped cells before a line (-1) or after it (1): straight on."""
        ahead_m = self.spacing_m * (np.arange(anywhere.HALO) + 1.0 if way > 0 else np.arange(-anywhere.HALO, 0.0))
        facing = np.array([np.cos(end[2]), np.sin(end[2])])
        return np.column_stack([end[:2] + ahead_m[:, None] * facing, np.full(anywhere.HALO, end[2])])

    def _noded(self, of: np.ndarray) -> np.ndarray:
        """Values of channels at the nodes: half way, the mean of two."""
        if not self._between:
            return of
        out = np.zeros((of.shape[0], 2 * of.shape[1] - 1, *of.shape[2:]), np.float32)
        out[:, ::2], out[:, 1::2] = of, 0.5 * (of[:, 1:] + of[:, :-1])
        return out

    def likelihood_for(self, array: ArrayGeometry) -> Likelihood:
        """Scores of foreign ground for an array's number of channels: the map's own cells moved to other places."""
        own = min(len(array.x_m), self.source.description.channels)
        if own not in self._likelihoods:
            self._likelihoods[own] = measure_likelihood(self._foreign(own))
        return self._likelihoods[own]

    def _foreign(self, channels: int) -> list[np.ndarray]:
        draw = np.random.default_rng(_SEED)
        value, known, place = (np.asarray(each) for each in (self.lines.value, self.lines.known, self.lines.pose))
        width = 2 * channels - 1 if self._between else channels
        every = 2 if self._between else 1
        whole = np.flatnonzero(known.all(axis=1))
        good = whole[np.isin(whole + _CHUNK - 1, whole)] if len(whole) else whole
        apart_m = 2.5 * self.wavelength_m + 1.0
        out: list[np.ndarray] = []
        for _ in range(20 * _STRETCHES):
            if len(out) == _STRETCHES or len(good) < 2:
                break
            first = int(draw.choice(good))
            low = int(draw.integers(known.shape[1] - width + 1))
            live = value[first : first + _CHUNK, low : low + width : every]
            others = draw.choice(good, size=_BESIDE)
            away = np.hypot(*(place[others, :2] - place[first, :2]).T) > apart_m + _CHUNK * self.spacing_m
            others = others[away]
            if len(others) < _BESIDE // 2:
                continue
            r = np.empty((_CHUNK, len(others)))
            for column, other in enumerate(others):
                under = value[other : other + _CHUNK, low : low + width : every]
                if draw.integers(2):
                    under = under[::-1, ::-1]
                norm = np.sqrt(np.sum(live**2, axis=(1, 2)) * np.sum(under**2, axis=(1, 2)))
                r[:, column] = np.sum(live * under, axis=(1, 2)) / np.maximum(norm, 1e-12)
            out.append(r)
        return out

    def heard(self, log: DriveLog) -> _Own:
        """Stops of a drive at the nodes of its array, with travel by its odometry."""
        array = log.description.array
        track = track_of_drive(log, self.source.description.frame).track
        operators = live_operators(self.source, log, track)
        chain = live_chain(self.ground, operators, array, int(operators(1.0).shape[0]))
        parts: list[tuple[np.ndarray, ...]] = []
        scans: list[np.ndarray] = []
        next_m = 0.0
        for low, recorded, valid in recording_of(log).blocks(BLOCK_SCANS):
            part = type(track)(*(field[low : low + len(recorded)] for field in track))
            fed = chain.feed(recorded, valid, part, BLOCK_SCANS)
            chosen, next_m = first_of_each(fed.path_m, self.spacing_m, next_m)
            if fed.background is not None:
                for earlier in parts:
                    earlier[0][:] -= np.where(earlier[1][..., None], fed.background, np.float32(0.0))
            parts.append((fed.filtered[chosen], valid[chosen], fed.path_m[chosen], part.pose[chosen]))
            scans.append(fed.number[chosen])
        filtered, valid, path_m, pose = (np.concatenate(field) for field in zip(*parts, strict=True))
        scan = np.concatenate(scans)
        left_m = array.y_m - centre_of(array)[1]
        above_m = pose[:, 2, None] + left_m * np.sin(pose[:, 4, None]) - self.ground.height_m
        frequency = self.ground.basis.angular_frequency_rad_per_ns
        live = []
        for scale in anywhere.SCALES:
            coefficients = chain.coefficients(filtered, valid, float(scale))
            level = shift_travel_time(
                jnp.asarray(coefficients), -air_delay_ns(jnp.asarray(above_m, jnp.float32)), frequency
            )
            live.append(np.asarray(level) @ self._components)
        traces = np.stack(live, axis=1) * valid[:, None, :, None]
        return _Own(self._at_nodes(traces, valid, left_m, path_m), scan, path_m, track.leg[scan])

    def _at_nodes(
        self,
        traces: Float[np.ndarray, "stop scale channel component"],
        valid: np.ndarray,
        left_m: Float[np.ndarray, " channel"],
        path_m: Float[np.ndarray, " stop"],
    ) -> anywhere.Heard:
        half = int(np.ceil(np.max(np.abs(left_m)) / self.node_m - 1e-6))
        own = 2 * half + 1
        share = np.zeros((2, len(left_m), own), np.float32)
        for way, sign in enumerate((1.0, -1.0)):
            # Nodes count from right to left, as the cells' do.
            at = sign * left_m / self.node_m + half
            low = np.clip(np.floor(at + 1e-6).astype(int), 0, max(own - 2, 0))
            part = np.clip(at - low, 0.0, 1.0)
            share[way, np.arange(len(at)), low] += 1.0 - part
            share[way, np.arange(len(at)), np.minimum(low + 1, own - 1)] += part
        loud = np.sum(traces**2, axis=3).mean(axis=1)
        loud = loud / np.maximum(loud.sum(axis=1, keepdims=True), 1e-30)
        travel_m = np.diff(path_m, prepend=path_m[0] - self.spacing_m)
        fields: dict[str, Any] = {
            "live": np.einsum("swck,dco->sdwok", traces, share).astype(np.float32),
            "weight": np.einsum("sc,dco->sdo", valid.astype(np.float32), share),
            "loud": np.einsum("sc,dco->sdo", loud, share).astype(np.float32),
            "at": path_m / self.spacing_m,
            "travel_m": travel_m.astype(np.float32),
            "there": np.ones(len(path_m), bool),
        }
        return anywhere.Heard(**fields)


@dataclass(frozen=True)
class LocatedDrive:
    """Result of locating a drive on a map, one row per start.

    Attributes:
        name: name of the drive.
        table: columns of ``NAME.located.csv``: ``start_scan``; ``scan``, whose position is given, after ``driven_m`` of
            travel; latitude, longitude and heading with their sigmas along and across the heading; ``p_false``, the
            probability that the start is false; ``hypotheses``, the number of places with more than a thousandth of the
            probability; ``code``: ``ok``, ``ambiguous`` (several places), ``not_yet`` (nothing likely enough) or
            ``off_map``.
    """

    name: str
    table: pd.DataFrame

    def save(self, folder: Path, *, force: bool = False) -> Path:
        """Write ``NAME.located.csv`` to a folder, created if missing. Raises ``InputError`` if writing fails."""
        make_folder(folder)
        target = folder / f"{self.name}.located.csv"
        digits = {"driven_m": 3, "latitude_deg": 9, "longitude_deg": 9, "heading_deg": 2}
        digits |= {"sigma_along_m": 4, "sigma_cross_m": 4}
        cells = self.table.copy()
        for column, places in digits.items():
            cells[column] = [f"{value:.{places}f}" if np.isfinite(value) else "" for value in cells[column]]
        cells["p_false"] = [f"{value:.3g}" for value in cells["p_false"]]
        with atomic_output(target, force=force) as temporary:
            cells.to_csv(temporary, index=False)
        return target


def check_every(every_m: float | None) -> None:
    """Refuse a distance between starts that cannot be. Raises ``ArgumentError``."""
    if every_m is None:
        return
    if isinstance(every_m, bool) or not isinstance(every_m, int | float | np.number):
        raise ArgumentError("every_m", "a number", repr(every_m)[:60])
    if not _LEAST_EVERY_M <= every_m <= 1e6:
        raise ArgumentError("every_m", f"a distance in metres, {_LEAST_EVERY_M:g} or more", f"{every_m:g}")


def locate_log(held: MapLines, log: DriveLog, every_m: float | None = None) -> LocatedDrive:
    """Find where a drive begins, at its first scan or every ``every_m`` metres, without its positions.

    Args:
        held: the map.
        log: the drive.
        every_m: distance between starts; None for one at the beginning.

    Raises:
        InputError: the recording cannot be used with the map.
    """
    own = held.heard(log)
    likelihood = held.likelihood_for(log.description.array)
    begins = np.arange(0.0, max(own.path_m[-1], 1e-6), every_m) if every_m else np.zeros(1)
    rows = [_located(held, own, int(np.searchsorted(own.path_m, begin - 1e-9)), likelihood) for begin in begins]
    return LocatedDrive(log.path.name.removesuffix(".drive.h5"), pd.DataFrame(rows, columns=list(COLUMNS)))


def _located(held: MapLines, own: _Own, start: int, likelihood: Likelihood) -> dict[str, object]:
    """The row of a start."""
    begin, path_m = start, own.path_m
    end = int(np.searchsorted(path_m, path_m[start] + MOST_M, side="right"))
    # Beyond a gap of the travel the stops before it carry no information.
    end = min(end, int(np.searchsorted(own.leg, own.leg[start], side="right")))
    last: anywhere.Report | None = None
    at, tries = start, 0
    while begin < end:
        tries += 1
        for at, report in _followed(held, own, begin, end, likelihood):
            # Each new proposal of places is another chance to be wrong.
            last = report._replace(p_false=jnp.minimum(tries * report.p_false, 1.0))
            if last.p_false < RISK:
                return _row(held, own, start, at, last, "ok")
            if float(report.foreign) > _LOST and path_m[at] - path_m[begin] > _AGAIN_M:
                break
        else:
            break
        begin = at + 1
    assert last is not None
    driven_m = path_m[at] - path_m[start]
    if float(last.foreign) > _OFF_MAP and driven_m > _OFF_MAP_M:
        return _row(held, own, start, at, last, "off_map")
    return _row(held, own, start, at, last, "not_yet" if float(last.foreign) > _LOST else "ambiguous")


def _followed(
    held: MapLines, own: _Own, begin: int, end: int, likelihood: Likelihood
) -> Iterator[tuple[int, anywhere.Report]]:
    """Reports of the stops from ``begin`` on."""
    node_m, spacing_m = held.node_m, held.spacing_m
    stops = own.heard._replace(at=(own.heard.at - own.heard.at[begin]).astype(np.float32))
    first = _part(stops, begin, min(begin + anywhere.FIRST, end), anywhere.FIRST)
    # Scans far apart would reach beyond a shard.
    first = first._replace(there=first.there & (first.at < anywhere.HALO - 1.0))
    places, shown = anywhere.propose(held.lines, first, likelihood, _PLACES)
    state = anywhere.begin(held.lines, places, stops.live.shape[3])
    wander = jnp.asarray([(_WANDER_M / spacing_m) ** 2, (_WANDER_M / node_m) ** 2], jnp.float32)
    known = Likelihood(*(jnp.float32(field) for field in likelihood[:3]))
    fixed = anywhere.Fixed(
        held.lines, known, jnp.float32(shown.memory), jnp.float32(spacing_m), wander, jnp.float32(node_m)
    )
    for low in range(begin, end, _CHUNK):
        high = min(low + _CHUNK, end)
        number = np.arange(low, low + _CHUNK) - begin
        scatter = np.full(_CHUNK, np.nan, np.float32)
        scatter[number < len(shown.variance)] = shown.variance[number[number < len(shown.variance)]]
        state, report = anywhere.run(state, _part(stops, low, high, _CHUNK), jnp.asarray(scatter), number == 0, fixed)
        found = jax.device_get(report)
        for each in range(high - low):
            yield low + each, jax.tree.map(lambda field, each=each: field[each], found)
        state = anywhere.recentred(state)


def _part(stops: anywhere.Heard, low: int, high: int, size: int) -> anywhere.Heard:
    """Some stops, filled up to a size."""
    at = np.minimum(np.arange(low, low + size), high - 1)
    part = anywhere.Heard(*(jnp.asarray(np.asarray(field)[at]) for field in stops))
    return part._replace(there=jnp.asarray(np.arange(low, low + size) < high))


def _row(held: MapLines, own: _Own, start: int, at: int, report: anywhere.Report, code: str) -> dict[str, object]:
    here = code in ("ok", "ambiguous")
    row: dict[str, object] = dict.fromkeys(COLUMNS, np.nan)
    row |= {
        "start_scan": int(own.scan[start]),
        "scan": int(own.scan[at]),
        "driven_m": float(own.path_m[at] - own.path_m[start]),
        "p_false": float(report.p_false),
        "hypotheses": _hypotheses(report),
        "code": code,
    }
    if here:
        frame = held.source.description.frame
        place = np.asarray(report.place_m, np.float64) + held.origin_m
        latitude, longitude, _ = frame.to_geodetic(place[:1], place[1:], np.zeros(1))
        heading = frame.heading_of_yaw(np.array([float(report.yaw)]), longitude)
        turn = rotation(float(report.yaw))
        # Headings, heights and places between nodes were not looked at; the map's labels have an error of their own.
        labels_m = np.asarray(held.source.description.label_sigma_m)
        least = (_UNSEEN * held.wavelength_m) ** 2 + (float(np.mean(labels_m**2)) if len(labels_m) else 0.0)
        sigma = np.sqrt(np.maximum(np.diag(turn.T @ np.asarray(report.covariance_m2) @ turn), 0.0) + least)
        row |= {
            "latitude_deg": float(latitude[0]),
            "longitude_deg": float(longitude[0]),
            "heading_deg": float(np.mod(heading[0], 360.0)),
            "sigma_along_m": float(sigma[0]),
            "sigma_cross_m": float(sigma[1]),
        }
    return row


def _hypotheses(report: anywhere.Report) -> int:
    """Places more than a metre apart with more than a thousandth of the probability."""
    kept: list[np.ndarray] = []
    for number in np.argsort(-report.mass):
        if report.mass[number] < _LIKELY:
            break
        if all(np.hypot(*(report.centre_m[number] - each)) > 1.0 for each in kept):
            kept.append(np.asarray(report.centre_m[number]))
    return len(kept)
