"""``python -m lgprjax.simulation.devices SPEC.json``: see ``stage`` for its contents."""

import sys
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.simulation.devices.program import run_devices


def main() -> int:
    """The program."""
    if len(sys.argv) != 2:
        print("usage: python -m lgprjax.simulation.devices SPEC.json", file=sys.stderr)
        return 2
    try:
        return run_devices(Path(sys.argv[1]))
    except InputError as error:
        print(error, file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
