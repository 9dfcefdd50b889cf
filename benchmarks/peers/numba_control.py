"""This project's kind of search in BLAS and Numba: the control that says what is the algorithm's gain, not JAX's.

One matrix product compares a scan, delayed to three heights, with what the array would hear at zero heading at every
coarse place; the two best places at least 0.25 m apart are refined by Gauss-Newton in all five dimensions
(``numba_finish``), and the one with the higher r stands.
"""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

import argparse

import numpy as np
from jaxtyping import Float, Int
from numba import njit, prange

from benchmarks.peers.numba_coarse import VECTORS, aligned_zeros, one_surface, stack_columns, two_starts
from benchmarks.peers.numba_finish import HALF_ROW, finish
from benchmarks.peers.worker import Peer, arguments, work
from benchmarks.registration import CHANNELS, LIGHT_SPEED_M_PER_NS, HardSet

_HEIGHTS = 3
_APART_M = 0.25
_STEPS = 4
_CHUNK = 60
"""Scans of one matrix product at most; fewer would pack the columns anew too often."""


class Control:
    """The search on a hard set.

    Attributes:
        rows: of each map, node by node; real parts, then imaginary parts, each padded to whole vectors.
        columns: of each prepared map, what the array hears at each coarse place, over its norm.
        mixer: of each prepared map, samples to coefficients and to the features at each height.
    """

    def __init__(
        self, hard_set: HardSet, rank: int, height_step_m: float, stride: tuple[int, int], threads: int
    ) -> None:
        self.hard_set, self.rank, self.threads = hard_set, rank, threads
        self.height_m = height_step_m * (np.arange(_HEIGHTS) - 1.0)
        self.cross = hard_set.ground.shape[2]
        counts = np.round(hard_set.half_width[:2] / hard_set.cell_m / stride).astype(int)
        centre = np.round(-hard_set.origin_m / hard_set.cell_m).astype(int)
        self.along = centre[0] + stride[0] * np.arange(-counts[0], counts[0] + 1)
        self.across = centre[1] + stride[1] * np.arange(-counts[1], counts[1] + 1)
        half = len(hard_set.omega)
        self.rows = np.zeros((len(hard_set.ground), self.cross * hard_set.ground.shape[1], 2 * HALF_ROW), np.float32)
        flat = hard_set.ground.reshape(len(hard_set.ground), -1, 2 * half)
        self.rows[..., :half], self.rows[..., HALF_ROW : HALF_ROW + half] = flat[..., :half], flat[..., half:]
        self.omega = np.zeros(HALF_ROW, np.float32)
        self.omega[:half] = hard_set.omega
        self.frame = np.concatenate([hard_set.origin_m, hard_set.cell_m, hard_set.prior[0], hard_set.half_width])
        self.places = (
            hard_set.origin_m[0] + self.along * hard_set.cell_m[0],
            hard_set.origin_m[1] + self.across * hard_set.cell_m[1],
            hard_set.prior[0, 2] + self.height_m,
        )
        places = len(self.along) * len(self.across)
        self.surface = np.empty((_HEIGHTS, places), np.float32)
        self.columns: dict[int, Float[np.ndarray, "place feature"]] = {}
        self.mixer: dict[int, Float[np.ndarray, "sample mixed"]] = {}

    def prepare(self, place: int) -> None:
        """Eigenbasis of the map's coefficients, columns of all coarse places, mixing matrix."""
        half = len(self.hard_set.omega)
        flat = self.hard_set.ground[place].reshape(-1, 2 * half)
        vectors = np.linalg.eigh(flat.T @ flat)[1][:, ::-1][:, : self.rank].astype(np.float32)
        offset = np.round(0.127 * (CHANNELS // 2 - np.arange(CHANNELS)) / self.hard_set.cell_m[1]).astype(int)
        power = np.einsum("nk,nk->n", flat, flat)
        columns = aligned_zeros(len(self.along) * len(self.across), -(-CHANNELS * self.rank // VECTORS) * VECTORS)
        stack_columns(flat @ vectors, power, self.along, self.across, offset, self.cross, columns)
        self.columns[place] = columns
        padded = np.zeros((len(self.hard_set.basis), 2 * HALF_ROW))
        padded[:, :half], padded[:, HALF_ROW : HALF_ROW + half] = np.split(self.hard_set.basis, 2, axis=1)
        parts = [padded]
        spectrum = self.hard_set.basis[:, :half] + 1j * self.hard_set.basis[:, half:]
        for height_m in self.height_m:
            earlier = spectrum * np.exp(1j * self.hard_set.omega * height_m * 2.0 / LIGHT_SPEED_M_PER_NS)
            parts.append(np.concatenate([earlier.real, earlier.imag], axis=1) @ vectors)
        self.mixer[place] = np.ascontiguousarray(np.concatenate(parts, axis=1), np.float32)

    def locate(self, place: int, samples: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        """Pose of one scan: places in parallel."""
        prepared = (self.mixer[place], self.columns[place], *self.places, self.rows[place])
        return np.asarray(_single(samples, *prepared, self.cross, self.frame, self.omega, self.threads, self.surface))

    def locate_many(self, place: int, samples: Float[np.ndarray, "scan channel sample"]) -> Float[np.ndarray, "scan 5"]:
        """Poses of scans on one map: scans in parallel, a chunk of them one matrix product."""
        prepared = (self.mixer[place], self.columns[place], *self.places, self.rows[place])
        chunks = self.threads * -(-len(samples) // (self.threads * _CHUNK))
        return np.asarray(_many(samples, *prepared, self.cross, self.frame, self.omega, chunks))


@njit(fastmath=True)
def _separate(mixed, heard, features):
    """Rows of [scan × channel] into what the finish hears and one row of features a scan and height."""
    channels, rank = heard.shape[1], (mixed.shape[1] - 2 * HALF_ROW) // _HEIGHTS
    for scan in range(heard.shape[0]):
        for channel in range(channels):
            row = mixed[scan * channels + channel]
            heard[scan, channel] = row[: 2 * HALF_ROW]
            for h in range(_HEIGHTS):
                begin = 2 * HALF_ROW + h * rank
                features[scan * _HEIGHTS + h, channel * rank : (channel + 1) * rank] = row[begin : begin + rank]


@njit(fastmath=True)
def _better_of_two(surface, along_m, across_m, height_m, rows, cross, frame, omega, heard, pose):
    starts, trial, best = np.empty((2, 3)), np.empty(5), -2.0
    two_starts(surface, along_m, across_m, height_m, _APART_M, starts)
    for start in range(2):
        trial[:3] = starts[start]
        trial[3], trial[4] = frame[7], frame[8]
        reached = finish(rows, cross, frame, omega, heard, trial, _STEPS)
        if reached > best:
            best = reached
            pose[:] = trial


@njit(fastmath=True)
def _single(samples, mixer, columns, along_m, across_m, height_m, rows, cross, frame, omega, threads, surface):
    mixed = np.dot(samples, mixer)
    heard = np.empty((1, len(samples), 2 * HALF_ROW), np.float32)
    features, pose = np.zeros((_HEIGHTS, columns.shape[1]), np.float32), np.empty(5)
    _separate(mixed, heard, features)
    one_surface(features, columns, threads, surface)
    _better_of_two(surface, along_m, across_m, height_m, rows, cross, frame, omega, heard[0], pose)
    return pose


@njit(fastmath=True, parallel=True)
def _many(samples, mixer, columns, along_m, across_m, height_m, rows, cross, frame, omega, chunks):
    poses, channels = np.empty((len(samples), 5)), samples.shape[1]
    flat = samples.reshape(-1, samples.shape[2])
    for chunk in prange(chunks):
        low, high = np.int64(chunk) * len(samples) // chunks, (np.int64(chunk) + 1) * len(samples) // chunks
        mixed = np.dot(flat[low * channels : high * channels], mixer)
        heard = np.empty((high - low, channels, 2 * HALF_ROW), np.float32)
        features = np.zeros(((high - low) * _HEIGHTS, columns.shape[1]), np.float32)
        _separate(mixed, heard, features)
        surface = np.dot(features, columns.T)
        for scan in range(high - low):
            mine = surface[scan * _HEIGHTS : (scan + 1) * _HEIGHTS]
            _better_of_two(mine, along_m, across_m, height_m, rows, cross, frame, omega, heard[scan], poses[low + scan])
    return poses


def build(hard_set: HardSet, chosen: argparse.Namespace) -> Peer:
    """The peer on a hard set."""
    stride = (chosen.stride_along, chosen.stride_cross)
    control = Control(hard_set, chosen.rank, chosen.height_step_m, stride, chosen.threads)

    def locate_all(problems: Int[np.ndarray, " problem"]) -> Float[np.ndarray, "problem 5"]:
        poses, places = np.empty((len(problems), 5)), hard_set.map_index[problems]
        for place in np.unique(places):
            here = places == place
            poses[here] = control.locate_many(int(place), hard_set.scans[problems[here]])
        return poses

    setting = f"rank {chosen.rank}, stride {stride[0]}x{stride[1]}"
    coarse = _HEIGHTS * len(control.along) * len(control.across)
    return Peer("numba_control", setting, coarse + 2 * (_STEPS + 1), control.prepare, control.locate, locate_all)


def main() -> None:
    """The program."""
    parser = arguments("numba_control", 0, 0)
    parser.add_argument("--rank", type=int, default=11, help="numbers a trace in the coarse stage; 44 are all")
    parser.add_argument("--height-step-m", type=float, default=0.0533)
    parser.add_argument("--stride-along", type=int, default=3, help="cells of 4 cm")
    parser.add_argument("--stride-cross", type=int, default=2, help="cells of 6.35 cm")
    chosen = parser.parse_args()
    work(chosen, lambda hard_set: build(hard_set, chosen))


if __name__ == "__main__":
    main()
