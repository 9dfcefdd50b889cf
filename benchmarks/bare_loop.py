"""A loop at 50 Hz that does nothing: what the machine itself does to a period (``python -m benchmarks.bare_loop``).

Its schedule is that of the control loop; it runs beside it, at the same priority.
"""

import argparse
import json
import time
from itertools import pairwise
from pathlib import Path

from lgprjax.runtime.process import run_in_real_time

_PERIOD_NS = 20_000_000


def main() -> None:
    """Write the periods' percentiles, ms, to OUT."""
    parser = argparse.ArgumentParser(prog="benchmarks.bare_loop")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--priority", type=int)
    chosen = parser.parse_args()
    if chosen.priority is not None:
        run_in_real_time("bare loop", chosen.priority, threads_too=True)
    begun = [time.monotonic_ns()]
    due_ns = begun[0]
    while due_ns - begun[0] < chosen.seconds * 1e9:
        due_ns += _PERIOD_NS
        wait_ns = due_ns - time.monotonic_ns()
        if wait_ns > 0:
            time.sleep(wait_ns / 1e9)
        begun.append(time.monotonic_ns())
    periods = sorted((after - before) / 1e6 for before, after in pairwise(begun))
    shares = {"p50": 0.5, "p99": 0.99, "p99_9": 0.999, "largest": 1.0}
    told = {name: periods[min(int(share * len(periods)), len(periods) - 1)] for name, share in shares.items()}
    chosen.out.write_text(json.dumps(told), encoding="utf-8")


if __name__ == "__main__":
    main()
