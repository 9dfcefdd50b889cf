"""The filter fed with a drive's scans in order, a few or a block at a time: each fix from earlier scans alone."""

import numpy as np
from jaxtyping import Float, Int

from lgprjax.registration.bayes.drive import CHUNK, SMOOTH_M, DriveFilter, Followed, astray_of
from lgprjax.registration.bayes.likelihood import Likelihood
from lgprjax.registration.bayes.refine import Reach, fill_coefficients, fixes_of, refined_m
from lgprjax.registration.fix import Fix, blank_fixes
from lgprjax.registration.judge import RegisterOptions
from lgprjax.registration.queries import LiveChain, LiveScans, Stops, stops_of
from lgprjax.registration.template_bank import PreparedGround


class FilterSearch:
    """The search of one drive by the Bayes filter.

    Args:
        prepared: ground of the map for the drive's array.
        chain: of the drive.
        options: of the search.
        likelihood: of map and array.
        sigma_scale: of the map, measured by the search's matches.
        block_scans: largest number of scans that ``feed`` is given: decides the compiled shapes.
    """

    def __init__(
        self,
        prepared: PreparedGround,
        chain: LiveChain,
        options: RegisterOptions,
        likelihood: Likelihood,
        sigma_scale: float,
        block_scans: int,
    ) -> None:
        self._prepared, self._chain, self._options, self._sigma_scale = prepared, chain, options, sigma_scale
        # A vehicle has a stop at a time.
        self._few = block_scans < CHUNK
        self.filter = DriveFilter(prepared, chain, options, likelihood, 1 if self._few else CHUNK)
        self._reach = Reach(refined_m(self.filter.wavelength_m), 0.0)
        self._stops: Stops | None = None
        self._unheard = 0
        self._next_m = -np.inf

    @property
    def history(self) -> int:
        """Stops behind one that refine its fix."""
        return int(np.ceil(self._reach.behind_m / self.filter.spacing_m))

    def feed(
        self, scans: LiveScans
    ) -> tuple[Int[np.ndarray, " stop"], Fix, Float[np.ndarray, "stop 2 2"], Float[np.ndarray, " stop"]]:
        """Stops among these scans (positions in the block) that have fixes, their fixes in the map's frame, the part of
        each covariance due to map and odometer, and the time scale.
        """
        chosen, self._next_m = self.filter.choose(scans, self._next_m)
        stops = stops_of(scans, chosen, self._prepared.array, self._prepared.ground.basis)
        if self._stops is not None:
            if scans.background is not None:
                self._stops.filtered[:] -= np.where(self._stops.valid[..., None], scans.background, np.float32(0.0))
            stops = Stops(*(np.concatenate(field) for field in zip(self._stops, stops, strict=True)))
        self._unheard += len(chosen)
        answered, fix, beside, scale = chosen[:0], blank_fixes(0), np.zeros((0, 2, 2)), np.zeros(0)
        # Scans before the background is known are heard once it is, and have no fixes.
        if scans.settled and self._unheard:
            fresh, astray = slice(len(stops.number) - self._unheard, None), astray_of(stops)
            found = self.filter.follow(Stops(*(field[fresh] for field in stops)), astray[fresh])
            late = int(np.searchsorted(scans.path_m[chosen], scans.settled_m)) if self._few else 0
            answered, first = chosen[late:], len(stops.number) - len(chosen) + late
            before = first - fresh.start
            earlier = Followed(*(field[:before] for field in found))
            fill_coefficients(Stops(*(field[fresh.start : first] for field in stops)), earlier, self._chain)
            if len(answered):
                fix, beside, scale = fixes_of(
                    stops,
                    Followed(*(field[before:] for field in found)),
                    self.filter,
                    self._prepared,
                    self._chain,
                    self._options,
                    self._sigma_scale,
                    self._reach,
                    few=self._few,
                )
            self._unheard = 0
        if len(stops.number):
            kept_m = max(self._reach.behind_m, SMOOTH_M)
            keep = int(np.searchsorted(stops.path_m, stops.path_m[-1] - kept_m))
            keep = min(keep, len(stops.number) - self._unheard)
            self._stops = Stops(*(field[keep:] for field in stops))
        return answered, fix, beside, scale
