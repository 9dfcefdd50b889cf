"""The command line: thin, one module per verb family. Heavy packages are imported when a verb runs, not for
``--help``.
"""

import sys
from collections.abc import Sequence

_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the ``lgprjax`` command.

    Nothing is imported before it is called, so that Ctrl-C ends it in one line from its first instant.
    """
    try:
        from lgprjax.cli.command import run_command

        status = run_command(sys.argv[1:] if arguments is None else arguments)
    except KeyboardInterrupt:
        # Commands report their unfinished outputs themselves; here none had begun, or all have ended.
        print("lgprjax: interrupted", file=sys.stderr)
        status = _INTERRUPTED
    sys.exit(status)


__all__ = ["main"]
