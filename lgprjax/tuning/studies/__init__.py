"""Logged drives in, a tuned vehicle file out: the studies of ``lgprjax tune``."""

from lgprjax.tuning.studies.logs import signals_of

__all__ = [
    "signals_of",
]
