"""Others' ways to solve the hard set, each a program of its own (``python -m benchmarks.peers.NAME --help``).

All search the same boxes with the same correlation over 11 channels of the bilinearly sampled map, clip or reflect
at the walls, and are compiled and warm before a clock runs. Nothing here knows the truth.
"""

PEERS = {
    "this_project": "jax",
    "numba_swarm": "numba",
    "numba_control": "numba",
    "pyswarms_peer": "pyswarms",
    "evosax_peer": "evosax",
    "direct_swarm": "jax",
}
"""Peer and the package that it needs."""

SERIAL_BLAS = frozenset({"numba_swarm", "numba_control"})
"""Peers whose threads are Numba's own: a second pool of threads inside BLAS would only wait in their way."""
