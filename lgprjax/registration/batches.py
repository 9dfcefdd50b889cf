"""Templates of a drive as batches of few shapes: which scans, which windows, where they start their search."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, cast

import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.radar import centre_of
from lgprjax.registration.live import LiveScans, trace_offsets, window_members
from lgprjax.registration.match import Ends, MatchSpec, ScanSet
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.prepared import PreparedGround

_ENDS = 64
_FINE = 0.3  # of the wavelength, from scan to scan of a window for the finish


class Batch(NamedTuple):
    """One call's worth of scans and templates."""

    scans: ScanSet
    ends: Ends


@dataclass(frozen=True)
class WindowLayout:
    """How the windows of a drive are made of scans, and how many go into a batch.

    Attributes:
        window_m: length; 0 for single scans.
        coarse_m, fine_m: from scan to scan of a window, for the coarse stage and for the finish.
        ends, scans: templates and scans of a batch.
        spec: of the search.
    """

    window_m: float
    coarse_m: float
    fine_m: float
    ends: int
    scans: int
    spec: MatchSpec

    @staticmethod
    def of(prepared: PreparedGround, options: RegisterOptions, ends: int | None = None) -> "WindowLayout":
        """Layout for a map and a window; ``ends`` templates a batch, or as many as pay and fit into memory."""
        window_m = options.window_m
        settings = prepared.ground.description.settings
        if window_m <= 0.0:
            single = MatchSpec(swarm=options.swarm)
            count = ends or _as_many_as_fit(prepared.places, single.heights, options, lambda count: count)
            return WindowLayout(0.0, 1.0, 1.0, count, count, single)
        coarse_m = max(float(prepared.step_m[0]), settings.step_m)
        # Few channels are finished on every station that a map could have: they have little else.
        fine_m = max(0.0 if prepared.few_channels else _FINE * settings.wavelength_m, settings.step_m)
        border = tuple(int(np.ceil(window_m / step)) + 1 for step in prepared.step_m)
        spec = MatchSpec(border=(border[0], border[1]), swarm=options.swarm)

        def scans_of(count: int) -> int:
            # Windows share the scans at whole steps: those of one window, and as many new ones.
            return 1 << int(count + 2.0 * window_m / fine_m).bit_length()

        # A window's scans are held twice, once with a border.
        count = ends or _as_many_as_fit(
            prepared.places, spec.heights, options, lambda count: 2 * scans_of(count) + 2 * count
        )
        return WindowLayout(window_m, coarse_m, fine_m, count, scans_of(count), spec)

    def members(
        self, scans: LiveScans, at: Int[np.ndarray, " end"]
    ) -> tuple[Int[np.ndarray, "end member"], Int[np.ndarray, "end fine"]]:
        """Scans of each template for the coarse stage and for the finish."""
        coarse = window_members(scans, at, window_m=self.window_m, step_m=self.coarse_m)
        fine = window_members(scans, at, window_m=self.window_m, step_m=self.fine_m)
        return coarse, fine

    def chunks(self, scans: LiveScans, at: Int[np.ndarray, " end"]) -> Iterator[tuple[int, int]]:
        """Ranges of ``at`` whose templates fit into one batch."""
        low = 0
        while low < len(at):
            high = min(low + self.ends, len(at))
            while self.window_m > 0.0 and high > low + 1:
                if len(np.unique(np.concatenate(self.members(scans, at[low:high]), axis=1))) <= self.scans:
                    break
                high = low + (high - low + 1) // 2
            yield low, high
            low = high

    def batch_of(
        self,
        prepared: PreparedGround,
        scans: LiveScans,
        at: Int[np.ndarray, " end"],
        frame: Float[np.ndarray, "3"],
        height_reference_m: float,
        options: RegisterOptions,
    ) -> Batch:
        """The batch of the templates that end at ``at``, filled up with its first template."""
        lanes = np.concatenate([at, np.full(self.ends - len(at), at[0])])
        coarse, fine = self.members(scans, lanes)
        used, where = np.unique(np.concatenate([coarse, fine], axis=1), return_inverse=True)
        where = where.reshape(len(lanes), -1)
        rows = np.concatenate([used, np.full(self.scans - len(used), used[0])])
        track = scans.track
        left_m = prepared.array.y_m - centre_of(prepared.array)[1]
        height_m = track.pose[rows, 2, None] + left_m * np.sin(track.pose[rows, 4, None])
        apart = scans.dead_reckoned_m[coarse] - scans.dead_reckoned_m[lanes][:, None]
        cos, sin = np.cos(frame[2]), np.sin(frame[2])
        apart = np.stack([apart @ [cos, sin], apart @ [-sin, cos]], axis=-1)
        prior = to_tile(track.pose[lanes], frame)
        scan_set = (
            scans.coefficients[rows].astype(np.float32, copy=False),
            scans.valid[rows],
            (height_m - height_reference_m).astype(np.float32),
        )
        ends = (
            where[:, : coarse.shape[1]].astype(np.int32),
            np.round(apart / prepared.step_m).astype(np.int32),
            where[:, coarse.shape[1] :].astype(np.int32),
            trace_offsets(scans, lanes, fine, prepared.array).astype(np.float32),
            np.pad(prior, [(0, 0), (0, 1)]).astype(np.float32),
            options.half_width(track.sigma_yaw_rad[lanes]).astype(np.float32),
            scans.number[lanes].astype(np.uint32),
        )
        # NumPy's, as a compiled function takes them: a transfer of each would cost as much as the call.
        return Batch(
            ScanSet(*cast("tuple[Array, Array, Array]", scan_set)),
            Ends(*cast("tuple[Array, Array, Array, Array, Array, Array, Array]", ends)),
        )


def _as_many_as_fit(places: int, heights: int, options: RegisterOptions, held: Callable[[int], int]) -> int:
    """Templates a batch, a power of two: ``held`` is how many surfaces of all places and heights so many take."""
    surface_mb = 4e-6 * heights * places
    # A long window's own scans are the most of it: then a few templates more cost hardly more.
    most_mb = max(options.memory_mb, 1.25 * surface_mb * held(1))
    count = _ENDS
    while count > 1 and surface_mb * held(count) > most_mb:
        count //= 2
    return count


def to_tile(pose: Float[np.ndarray, "batch 5"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "batch 5"]:
    """Poses of the map's frame in that of a tile."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    out = pose.copy()
    out[:, 0] = cos * (pose[:, 0] - east) + sin * (pose[:, 1] - north)
    out[:, 1] = cos * (pose[:, 1] - north) - sin * (pose[:, 0] - east)
    out[:, 3] = np.mod(pose[:, 3] - yaw + np.pi, 2 * np.pi) - np.pi
    return out
