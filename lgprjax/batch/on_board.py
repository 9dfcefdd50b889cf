"""The search of a run, made again from its drive log: the same scans and priors give the fixes it was driven by."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.errors import InputError
from lgprjax.formats import DriveLog
from lgprjax.frames import LocalFrame
from lgprjax.recordings.drives import recording_of
from lgprjax.registration import (
    BLOCK_SCANS,
    FINISH_SWARM,
    SEARCH_SWARM,
    Code,
    DriveFixes,
    Fix,
    LiveBlock,
    RegisterOptions,
    Thresholds,
    Track,
)
from lgprjax.registration.fix import blank_fixes


class OnBoard(NamedTuple):
    """Inputs and results of the search on board, per scan.

    Attributes:
        scan: number of the scan in the drive log.
        begins: whether the scan is the first of a new search, without earlier state.
        valid: mask of the channels used.
        track: priors.
        code: code of the fix; ``NO_WINDOW`` for scans without a fix of their own.
        fix_m: east and north of the fix of the array's centre; NaN without a fix.
    """

    scan: Int[np.ndarray, " searched"]
    begins: Bool[np.ndarray, " searched"]
    valid: Bool[np.ndarray, "searched channel"]
    track: Track
    code: Int[np.ndarray, " searched"]
    fix_m: Float[np.ndarray, "searched 2"]


def on_board_of(log: DriveLog, frame: LocalFrame) -> OnBoard | None:
    """The search made on board, in a map's frame; ``None`` for a log without one.

    Raises:
        InputError: the search was made on a map of another frame.
    """
    told = log.description.on_board
    if told is None:
        return None
    there, here = ((each.latitude_deg, each.longitude_deg, each.height_m) for each in (told.frame, frame))
    if there != here:
        latitude, longitude, _ = there
        expected, found = f"the map of the run, anchored at {latitude:.6f}, {longitude:.6f}", "another map"
        raise InputError(log.path, "/on_board", expected, found)
    scans, count = told.scans, len(told.scans["scan"])
    # The priors bit by bit, because a peak may be between two points of a lattice.
    track = Track(
        scans["pose_m"],
        scans["travel_m"],
        scans["speed_mps"],
        scans["sigma_yaw_rad"],
        np.full(count, np.nan),
        np.zeros(count, np.int64),
    )
    scan, code = scans["scan"].astype(np.int64), scans["code"].astype(np.int64)
    return OnBoard(scan, scans["begins"] != 0, scans["valid"] != 0, track, code, scans["fix_m"])


def searches_of(log: DriveLog, searched: OnBoard) -> Iterator[tuple[Int[np.ndarray, " scan"], Iterator[LiveBlock]]]:
    """Every search of a run: its scans by their numbers in the log, and these as blocks."""
    starts = np.flatnonzero(searched.begins)
    for begin, end in zip(starts, [*starts[1:], len(searched.scan)], strict=True):
        own = slice(int(begin), int(end))
        yield searched.scan[own], _blocks(log, searched, own)


def _blocks(log: DriveLog, searched: OnBoard, own: slice) -> Iterator[LiveBlock]:
    numbers = searched.scan[own]
    for low, recorded, _ in recording_of(log).blocks(BLOCK_SCANS, int(numbers[0])):
        here = np.flatnonzero((numbers >= low) & (numbers < low + len(recorded)))
        if len(here):
            track = Track(*(field[own][here] for field in searched.track))
            yield LiveBlock(recorded[numbers[here] - low], searched.valid[own][here], track)
        if numbers[-1] < low + len(recorded):
            return


def placed(parts: list[DriveFixes], numbers: list[Int[np.ndarray, "..."]], scans: int) -> DriveFixes:
    """Fixes of some scans as those of a whole drive; the others have none."""
    out = DriveFixes(
        np.arange(scans),
        blank_fixes(scans),
        np.full((scans, 2, 2), np.nan),
        np.ones(scans),
        np.zeros(scans, bool),
        np.full(scans, np.nan),
    )
    for part, number in zip(parts, numbers, strict=True):
        for whole, some in zip(out.fix, part.fix, strict=True):
            np.asarray(whole)[number] = some
        for name in ("map_odometry_covariance", "time_scale", "searched", "correlation_at_truth"):
            getattr(out, name)[number] = getattr(part, name)
    return out


class Agreement(NamedTuple):
    """Agreement of repeated fixes with those of the run.

    Attributes:
        fixes: number of scans with a fix of their own on board.
        same_code: number of these with the same code.
        largest_m: largest distance between positions with the same code.
    """

    fixes: int
    same_code: int
    largest_m: float

    @property
    def told(self) -> str:
        """The agreement in one line."""
        off = f"at most {1e3 * self.largest_m:.2g} mm apart" if self.same_code else "none"
        return f"as on board: {self.same_code} of {self.fixes} fixes with the same code, {off}"


def agreement(searched: OnBoard, fix: Fix) -> Agreement:
    """Compare fixes of a drive with those made during its run."""
    own = searched.code != Code.NO_WINDOW
    at = searched.scan[own]
    same = np.asarray(fix.code)[at] == searched.code[own]
    apart = np.hypot(*(np.asarray(fix.pose)[at, :2] - searched.fix_m[own]).T)[same]
    return Agreement(int(own.sum()), int(same.sum()), float(np.nanmax(apart, initial=0.0)))


# The options that a run searched with, kept in its log's provenance.


def options_as_provenance(options: RegisterOptions) -> dict[str, Any]:
    """Options of a search as JSON for the provenance."""
    own = options.own_thresholds
    return {
        "search_m": options.search_m,
        "window_m": options.window_m,
        "risk": options.risk,
        "time_scale": options.time_scale,
        "thresholds": None if own is None else {name: float(value) for name, value in own._asdict().items()},
        "finish": "newton" if options.swarm is None else "swarm",
        "search": "filter" if options.filter else "swarm" if options.search_swarm else "exhaustive",
    }


def options_on_board(log: DriveLog) -> RegisterOptions | None:
    """Kind of search of a run; ``None`` for a log that does not state it."""
    told = log.description.provenance.get("registration")
    if not isinstance(told, dict):
        return None
    own = told["thresholds"]
    return RegisterOptions(
        search_m=told["search_m"],
        window_m=told["window_m"],
        risk=told["risk"],
        time_scale=told["time_scale"],
        own_thresholds=None if own is None else Thresholds(**own),
        swarm=FINISH_SWARM if told["finish"] == "swarm" else None,
        search_swarm=SEARCH_SWARM if told["search"] == "swarm" else None,
        filter="causal" if told["search"] == "filter" else None,
        track=True,
    )
