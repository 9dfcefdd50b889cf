"""The command line: thin, one module a verb. Heavy rooms are imported when a verb runs, not for ``--help``."""

from lgprjax.cli.main import main

__all__ = ["main"]
