"""The recorder as a program of its own, for the tests: RINGS RUN CONFIG AFTER_DEATH LARGEST_FILE."""

import resource
import sys
from pathlib import Path

from lgprjax.runtime.config import read_config
from lgprjax.runtime.process import Started
from lgprjax.runtime.recorder import run


def main() -> None:
    """Be a recorder."""
    rings, folder, config, after_death, limit = sys.argv[1:]
    if int(limit):
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(limit), int(limit)))
    run(Started("recorder", read_config(config), Path(rings), Path(folder), bool(int(after_death))))


if __name__ == "__main__":
    main()
