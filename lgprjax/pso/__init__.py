"""Bounded particle swarm search."""

from lgprjax.pso.swarm import (
    Objective,
    SwarmConfig,
    SwarmResult,
    SwarmState,
    SwarmTrail,
    init_swarm,
    run_swarm,
    step_swarm,
    watch_swarm,
)

__all__ = [
    "Objective",
    "SwarmConfig",
    "SwarmResult",
    "SwarmState",
    "SwarmTrail",
    "init_swarm",
    "run_swarm",
    "step_swarm",
    "watch_swarm",
]
