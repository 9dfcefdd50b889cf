"""Bounded particle swarm search."""

from lgprjax.pso.swarm import (
    Objective,
    SwarmConfig,
    SwarmResult,
    SwarmState,
    init_swarm,
    run_swarm,
    step_swarm,
)

__all__ = [
    "Objective",
    "SwarmConfig",
    "SwarmResult",
    "SwarmState",
    "init_swarm",
    "run_swarm",
    "step_swarm",
]
