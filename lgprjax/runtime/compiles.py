"""Compilations counted: once a process is ready there may be none."""

from collections.abc import Callable

import jax

_EVENT = "/jax/core/compile/backend_compile_duration"


def count_compiles() -> Callable[[], int]:
    """How many programs this process has compiled, or fetched from the cache, since this call."""
    counted = 0

    def listen(event: str, duration_secs: float, **_: str | int) -> None:
        nonlocal counted
        counted += event == _EVENT and duration_secs >= 0.0

    jax.monitoring.register_event_duration_secs_listener(listen)
    return lambda: counted
