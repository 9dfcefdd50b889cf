"""What a terminal is told while nothing moves."""

import io

import jax.monitoring
import pytest
from rich.console import Console

from lgprjax.cli.terminal import _COMPILING, Compiling

_MISS, _HIT = ("/jax/compilation_cache/cache_misses", "/jax/compilation_cache/cache_hits")
_TOOK = "/jax/core/compile/backend_compile_duration"


@pytest.fixture(scope="module")
def compiling() -> Compiling:
    """One for all tests: JAX keeps its listeners."""
    return Compiling()


def _compile(compiling: Compiling, *programs: tuple[str, float]) -> str:
    """What is shown while programs are compiled, or loaded, in so many seconds each."""
    compiling.__dict__.update(_new=False, _took_s=0.0)
    shown = Console(file=io.StringIO(), force_terminal=True, width=40)
    with compiling.told_on(shown):
        for event, took_s in programs:
            jax.monitoring.record_event(event)
            jax.monitoring.record_event_duration_secs(_TOOK, took_s)
    jax.monitoring.record_event(_MISS)
    jax.monitoring.record_event_duration_secs(_TOOK, 100.0)
    return shown.file.getvalue()  # type: ignore[attr-defined,no-any-return]


def test_a_first_command_says_once_that_it_compiles(compiling: Compiling) -> None:
    told = _compile(compiling, (_MISS, 0.4), (_MISS, 0.8), (_MISS, 20.0))
    assert " ".join(told.split()) == _COMPILING
    assert _compile(compiling, (_HIT, 5.0), (_HIT, 5.0), (_MISS, 0.4), (_HIT, 5.0)) == ""
