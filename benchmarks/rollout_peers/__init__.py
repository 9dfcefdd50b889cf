"""Programs that drive the same lanes, each in a process of its own (``python -m benchmarks.rollout_peers.NAME``).

All are compiled and warm before a clock runs, and leave their final states for comparison.
"""

ROLLOUT_PEERS = {
    "this_project": "jax",
    "numba_blocks": "numba",
    "numba_lanes": "numba",
    "plain_python": "numpy",
}
"""Program and the package that it needs."""
