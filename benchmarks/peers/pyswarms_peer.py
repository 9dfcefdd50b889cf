"""PySwarms' local-best swarm on a vectorised NumPy score.

Walls reflect and neighbours are fixed at the start, as in the other swarms here. A neighbour is a particle that is
near then: the package knows no ring by number.
"""

import argparse

import numpy as np
from jaxtyping import Float
from pyswarms.single.local_best import LocalBestPSO

from benchmarks.peers.worker import Peer, arguments, work
from benchmarks.registration import CHANNEL_LEFT_M, LIGHT_SPEED_M_PER_NS, SAMPLE_INTERVAL_NS, HardSet

_OPTIONS = {"w": 0.7298, "c1": 1.49618, "c2": 1.49618, "k": 5, "p": 2}
_MARGIN = 8
_PER_M = 2.0 / LIGHT_SPEED_M_PER_NS


class NumpyScore:
    """Correlation of a scan with a map at many poses in NumPy, band-limited or of all samples."""

    def __init__(self, hard_set: HardSet, full: bool) -> None:
        self.hard_set, self.full = hard_set, full
        self.cross = hard_set.ground.shape[2]
        self.basis = hard_set.basis.astype(np.float32)
        rows = hard_set.ground.reshape(len(hard_set.ground), -1, hard_set.ground.shape[-1])
        self.rows = [part @ self.basis.T for part in rows] if full else list(rows)
        self.omega = hard_set.omega.astype(np.float32)
        self.left = CHANNEL_LEFT_M.astype(np.float32)

    def live(self, samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, "channel number"]:
        """What of a scan is compared: itself, or its numbers in the band."""
        return samples if self.full else samples @ self.basis

    def at(
        self, place: int, live: Float[np.ndarray, "channel number"], pose: Float[np.ndarray, "particle 5"]
    ) -> Float[np.ndarray, " particle"]:
        """r at each pose."""
        pose = pose.astype(np.float32)
        cos, sin = np.cos(pose[:, 3, None]), np.sin(pose[:, 3, None])
        where = np.stack([pose[:, 0, None] - sin * self.left, pose[:, 1, None] + cos * self.left], axis=-1)
        cells = ((where - self.hard_set.origin_m) / self.hard_set.cell_m).astype(np.float32)
        low = cells.astype(np.int32)
        a, b = np.moveaxis(cells - low, -1, 0)[..., None]
        node = low[..., 0] * self.cross + low[..., 1]
        rows = self.rows[place]
        ground = rows[node] * ((1 - a) * (1 - b))
        ground += rows[node + 1] * ((1 - a) * b)
        ground += rows[node + self.cross] * (a * (1 - b))
        ground += rows[node + self.cross + 1] * (a * b)
        rise = pose[:, 2, None] - np.float32(self.hard_set.prior[0, 2]) + self.left * np.sin(pose[:, 4, None])
        shifted = self._earlier(live, np.float32(_PER_M) * rise)
        product = np.einsum("pck,pck->p", shifted, ground)
        power = np.einsum("pck,pck->p", ground, ground)
        strength = np.einsum("pck,pck->p", shifted, shifted)
        return np.asarray(product / np.sqrt(power * strength + 1e-30))

    def _earlier(
        self, live: Float[np.ndarray, "channel number"], delay_ns: Float[np.ndarray, "particle channel"]
    ) -> Float[np.ndarray, "particle channel number"]:
        if self.full:
            later = delay_ns / np.float32(SAMPLE_INTERVAL_NS)
            first = np.floor(later).astype(np.int32)
            part = (later - first)[..., None]
            # Delays are circular, as the map's frequencies are; whole windows are copied, sample by sample is slow.
            samples = live.shape[1]
            padded = np.concatenate([live[:, -_MARGIN:], live, live[:, :_MARGIN]], axis=1)
            windows = np.lib.stride_tricks.sliding_window_view(padded, samples + 1, axis=1)
            near = windows[np.arange(len(live)), first + _MARGIN]
            return np.asarray((1 - part) * near[..., :-1] + part * near[..., 1:])
        half = len(self.omega)
        angle = delay_ns[..., None] * self.omega
        cos, sin = np.cos(angle), np.sin(angle)
        real, imaginary = live[None, :, :half], live[None, :, half:]
        return np.concatenate([real * cos - imaginary * sin, imaginary * cos + real * sin], axis=-1)


def build(hard_set: HardSet, chosen: argparse.Namespace) -> Peer:
    """The peer on a hard set."""
    score = NumpyScore(hard_set, chosen.full)
    centre, half_width = hard_set.prior[0], hard_set.half_width
    box = (-np.ones(5), np.ones(5))

    def locate(place: int, samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        live = score.live(samples)
        np.random.seed(1)  # noqa: NPY002 - the package draws from NumPy's global stream
        swarm = LocalBestPSO(
            chosen.particles, 5, _OPTIONS, bounds=box, bh_strategy="reflective", velocity_clamp=(-0.5, 0.5), static=True
        )
        _, u = swarm.optimize(
            lambda u: -score.at(place, live, centre + half_width * u), chosen.iterations + 1, verbose=False
        )
        return np.asarray(centre + half_width * u)

    setting = f"{'full' if chosen.full else 'band'} {chosen.particles}x{chosen.iterations}"
    return Peer("pyswarms_peer", setting, chosen.particles * (chosen.iterations + 1), lambda _: None, locate, None)


def main() -> None:
    """The program."""
    chosen = arguments("pyswarms_peer", 256, 40).parse_args()
    work(chosen, lambda hard_set: build(hard_set, chosen))


if __name__ == "__main__":
    main()
