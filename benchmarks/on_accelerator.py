"""This project on an accelerator, where JAX finds one; a program (``python -m benchmarks.on_accelerator``)."""

import argparse
import json
from pathlib import Path

import jax

from benchmarks.peers import this_project
from benchmarks.peers.worker import work


def main() -> None:
    """The program: a peer's result with the device's name as its setting, or an empty object."""
    parser = argparse.ArgumentParser(prog="benchmarks.on_accelerator")
    parser.add_argument("out", type=Path)
    parser.add_argument("hard_set", type=Path)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("--threads", type=int, default=1)
    chosen = parser.parse_args()
    if jax.default_backend() == "cpu":
        chosen.out.write_text("{}\n", encoding="utf-8")
        return
    chosen.stride, chosen.swarm = (3, 2), None
    work(chosen, lambda hard_set: this_project.build(hard_set, chosen))
    result = json.loads(chosen.out.read_text(encoding="utf-8"))
    result["setting"] += f", {jax.devices()[0].device_kind}"
    chosen.out.write_text(json.dumps(result) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
