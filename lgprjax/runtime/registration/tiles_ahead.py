"""Tiles made ready before the vehicle comes to them: in a thread, on a ground of its own."""

import threading
from collections.abc import Iterable

import jax
import numpy as np
from jaxtyping import Float

from lgprjax.formats import MapFile
from lgprjax.radar import ArrayGeometry
from lgprjax.registration import Aspect, PreparedGround, PreparedTile, RegisterOptions, ground_map_for

AHEAD_M = (0.0, 1.0, 2.0, 3.0)
"""How far ahead of the array tiles are made ready; the first is where it is."""
_SLACK_M = 0.5  # what the search's lattice reaches beyond its region, up to a step


class TilesAhead:
    """A thread that prepares what it is asked for, the newest wish first done.

    What it computes releases the interpreter, so that the search goes on beside it; its tiles are handed over when the
    search asks (``PreparedGround.hold``), never changed in its back.
    """

    def __init__(self, source: MapFile, array: ArrayGeometry, options: RegisterOptions) -> None:
        self._ground = ground_map_for(source, options)
        self._prepared = PreparedGround(self._ground, array, keep=1)
        self._reach_m = options.search_half_m() + _SLACK_M
        self._tile: int | None = None
        self._wish: list[Aspect] = []
        self._ready: list[tuple[Aspect, PreparedTile]] = []
        self._news = threading.Condition()
        self._ending = False
        self._thread = threading.Thread(target=self._run, name="tiles ahead", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        with self._news:
            self._ending = True
            self._news.notify()
        self._thread.join(timeout=5.0)

    def wish(self, poses: Iterable[Float[np.ndarray, "5"]], speed_mps: float, into: PreparedGround) -> None:
        """Prepare for these places, the first being the vehicle's own; those that the search holds already are left
        out. What is ready is handed over."""
        aspects: list[Aspect] = []
        tile = self._tile
        for number, pose in enumerate(poses):
            # As the search chooses: a tile stays in use as long as it serves.
            tile = self._ground.tile_holding(tile, pose[:2], self._reach_m)
            if number == 0:
                self._tile = tile
            if tile is None:
                continue
            aspect = self._prepared.aspects(np.array([tile]), pose[None, 3], np.array([speed_mps]))[0][0]
            if not into.holds(aspect) and aspect not in aspects:
                aspects.append(aspect)
        with self._news:
            done, self._ready = self._ready, []
            ready = {aspect for aspect, _ in done}
            self._wish = [aspect for aspect in aspects if aspect not in ready]
            if self._wish:
                self._news.notify()
        for aspect, tile_ready in done:
            if not into.holds(aspect):
                into.hold(aspect, tile_ready)

    def _run(self) -> None:
        while True:
            with self._news:
                while not self._wish and not self._ending:
                    self._news.wait()
                if self._ending:
                    return
                aspect = self._wish.pop(0)
                if any(aspect == known for known, _ in self._ready):
                    continue
            made = self._prepared.make(aspect)
            jax.block_until_ready(made)
            with self._news:
                self._ready.append((aspect, made))
