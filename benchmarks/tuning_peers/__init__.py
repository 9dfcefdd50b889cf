"""Programs that fit the same drives or judge the same draws, each in a process of its own.

``python -m benchmarks.tuning_peers.NAME``. This project's runs first and leaves the problem of the other two.
"""

TUNING_PEERS = {"this_project": "jax", "scipy_fit": "scipy", "numpy_draws": "numpy"}
"""Program and the package that it needs."""
