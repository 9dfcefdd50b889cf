"""The command line: thin, one module per verb family. Heavy packages are imported when a verb runs, not for
``--help``.
"""

from lgprjax.cli.main import main

__all__ = ["main"]
