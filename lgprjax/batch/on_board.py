"""The search of a run, made again from its drive log: the same scans and priors give the fixes it was driven by."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.batch.recording import recording_of
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog
from lgprjax.frames import LocalFrame
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
    """What a vehicle's search was given, scan by scan, and what it found.

    Attributes:
        scan: number in the drive log.
        begins: first of a search, which knows nothing from before.
        valid: channels that were used.
        track: priors.
        code: of the fix; ``NO_WINDOW`` where the scan has none of its own.
        fix_m: east and north of the array's centre as found; NaN without.
    """

    scan: Int[np.ndarray, " searched"]
    begins: Bool[np.ndarray, " searched"]
    valid: Bool[np.ndarray, "searched channel"]
    track: Track
    code: Int[np.ndarray, " searched"]
    fix_m: Float[np.ndarray, "searched 2"]


def on_board_of(log: DriveLog, frame: LocalFrame) -> OnBoard | None:
    """The search as it was made on board, in a map's frame; ``None`` of a log that holds none.

    Raises:
        InputError: it was made on a map of another frame.
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
    # As it was given, to the bit: a peak may stand between two points of a lattice.
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
    """Fixes found again against those of the run.

    Attributes:
        fixes: scans with a fix of their own on board.
        same_code: of these.
        largest_m: between the places of one code.
    """

    fixes: int
    same_code: int
    largest_m: float

    @property
    def told(self) -> str:
        """One line."""
        off = f"at most {1e3 * self.largest_m:.2g} mm apart" if self.same_code else "none"
        return f"as on board: {self.same_code} of {self.fixes} fixes with the same code, {off}"


def agreement(searched: OnBoard, fix: Fix) -> Agreement:
    """How far fixes of a drive agree with those that its run was driven by."""
    own = searched.code != Code.NO_WINDOW
    at = searched.scan[own]
    same = np.asarray(fix.code)[at] == searched.code[own]
    apart = np.hypot(*(np.asarray(fix.pose)[at, :2] - searched.fix_m[own]).T)[same]
    return Agreement(int(own.sum()), int(same.sum()), float(np.nanmax(apart, initial=0.0)))


# The options that a run searched with, kept in its log's provenance.


def options_as_provenance(options: RegisterOptions) -> dict[str, Any]:
    """What a run decides about its search."""
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
    """The search that a run was made with; ``None`` of a log that does not say."""
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
