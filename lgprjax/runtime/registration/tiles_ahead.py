"""Tiles made ready before the vehicle comes to them: in a thread, on a ground of its own."""

import threading
from collections.abc import Iterable

import jax
import numpy as np
from jaxtyping import Float

from lgprjax.formats import MapFile
from lgprjax.radar import ArrayGeometry
from lgprjax.registration import Aspect, PreparedGround, PreparedTile, RegisterOptions, Track, tracking_ground

AHEAD_M = (1.0, 2.0, 3.0)
"""How far ahead of the array tiles are made ready."""


class TilesAhead:
    """A thread that prepares what it is asked for, the newest wish first done.

    What it computes releases the interpreter, so that the search goes on beside it; its tiles are handed over when the
    search asks (``PreparedGround.hold``), never changed in its back.
    """

    def __init__(self, source: MapFile, array: ArrayGeometry, options: RegisterOptions) -> None:
        self._ground = tracking_ground(source, options)
        self._prepared = PreparedGround(self._ground, array, keep=1)
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
        """Prepare for these places; those that the search holds already are left out. What is ready is handed over."""
        aspects: list[Aspect] = []
        for pose in poses:
            tile = self._ground.tile_near(pose[:2], 0.5)
            if tile is None:
                continue
            one = Track(pose[None], np.zeros(1), np.array([speed_mps]), np.zeros(1))
            aspect = self._prepared.aspects(np.array([tile]), one, np.array([0]))[0][0]
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
