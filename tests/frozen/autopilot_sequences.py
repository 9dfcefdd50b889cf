"""Seeded sequences through the command limiters and the mode machine, as digests of what comes out.

The limiters are fed sums of powers of two, which any processor computes to the bit; the mode machine computes nothing.
"""

import hashlib
import re

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int32

from lgprjax.autopilot import (
    Check,
    Command,
    Event,
    LimiterRules,
    LimiterState,
    ModeEvent,
    ModeState,
    SkidCommand,
    SkidLimiterRules,
    inhibit_of,
    init_limiter,
    limit_command,
    released,
    step_modes,
)

_LANES, _STEPS = 64, 60
_RULES = (0.5, 0.5, 1.0, 2.0, 0.25, 0.375, 0.125)
_SKID_RULES = (0.5, 1.0, 0.25, 0.25, 0.5)
_SEQUENCES, _EVENTS = 200, 80
_TO_SPEED = (
    Event.BOOT_DONE,
    Event.CHECKS_PASSED,
    Event.ROUTE_NEAR,
    Event.MOVING,
    Event.SOURCES_PRESENT,
    Event.HEALTH_GOOD,
    Event.STEERING_BUTTON,
    Event.CRUISE_PLUS,
)


@jax.jit
def _limit(
    rules: LimiterRules, start: LimiterState[Command], told: Float[Array, "step 5 lane"]
) -> tuple[Float[Array, "step 3 lane"], Int32[Array, "step lane"]]:
    def step(state, now):  # type: ignore[no-untyped-def]
        state, sent, bits = limit_command(rules, state, Command(*now[:3]), now[3], now[4])
        return state, (jnp.stack(sent), bits)

    driven: tuple[Float[Array, "step 3 lane"], Int32[Array, "step lane"]] = jax.lax.scan(step, start, told)[1]
    return driven


@jax.jit
def _limit_skid(
    rules: SkidLimiterRules, start: LimiterState[SkidCommand], told: Float[Array, "step 6 lane"]
) -> tuple[Float[Array, "step 4 lane"], Int32[Array, "step lane"]]:
    def step(state, now):  # type: ignore[no-untyped-def]
        state, sent, bits = limit_command(rules, state, SkidCommand(*now[:4]), now[4], now[5])
        return state, (jnp.stack(sent), bits)

    driven: tuple[Float[Array, "step 4 lane"], Int32[Array, "step lane"]] = jax.lax.scan(step, start, told)[1]
    return driven


def _told(seed: int, reach: tuple[float, ...]) -> np.ndarray:
    """Commands in eighths within a reach of each, then age and step; a few no numbers, too old or out of order."""
    rng = np.random.default_rng(seed)
    shape = (_STEPS, len(reach), _LANES)
    command = rng.integers(-8, 9, shape) / 8.0 * np.array(reach)[:, None]
    age = rng.choice(
        [0.0, 0.0625, 0.25, 0.5, -0.125, np.nan], (_STEPS, 1, _LANES), p=[0.3, 0.4, 0.27, 0.01, 0.01, 0.01]
    )
    step = rng.choice([0.125, 0.0625, 0.0, np.nan], (_STEPS, 1, _LANES), p=[0.8, 0.17, 0.02, 0.01])
    command[rng.random(shape) < 0.003] = np.nan
    command[rng.random(shape) < 0.003] = np.inf
    return np.concatenate([command, age, step], axis=1).astype(np.float32)


def _digest(*parts: np.ndarray) -> str:
    digest = hashlib.sha256()
    for part in parts:
        # Zero has two signs, and which one comes out is of no account.
        digest.update(np.ascontiguousarray(part + part.dtype.type(0)).tobytes())
    return digest.hexdigest()


def limiter_digest() -> dict[str, object]:
    """Digest of commands sent and of their bits; how often each bit was set."""
    rules = LimiterRules(*(jnp.float32(rule) for rule in _RULES))
    told = jnp.asarray(_told(11, (1.0, 1.5, 1.5)))
    sent, bits = map(np.asarray, _limit(rules, init_limiter(released(jnp.zeros(_LANES, jnp.float32))), told))
    return {"sha256": _digest(sent, bits), "bits_set": _counts(bits)}


def skid_limiter_digest() -> dict[str, object]:
    """The same of the skid-steer limiter.

    A stop along an arc divides: what is sent then is rounded to 1e-5 m/s before it is compared.
    """
    rules = SkidLimiterRules(*(jnp.float32(rule) for rule in _SKID_RULES))
    still = jnp.zeros(_LANES, jnp.float32)
    told = jnp.asarray(_told(12, (1.0, 1.0, 1.0, 0.5)))
    sent, bits = map(np.asarray, _limit_skid(rules, init_limiter(SkidCommand(still, still, still, still)), told))
    return {
        "sha256": _digest(np.round(sent.astype(np.float64) * 1e5).astype(np.int64), bits),
        "bits_set": _counts(bits),
    }


def _counts(bits: np.ndarray) -> dict[str, int]:
    return {str(1 << place): int(np.sum(bits >> place & 1)) for place in range(12) if np.any(bits >> place & 1)}


def modes_digest() -> dict[str, object]:
    """Digest of modes, actions and refusals by name; half of the sequences begin at a driven speed.

    Every event comes in its turn, those that a drive is full of more often; in a quarter of them nothing fails.
    """
    rng = np.random.default_rng(13)
    every = [*Event, *_TO_SPEED, *_TO_SPEED]
    quiet = [event for event in every if not re.search("DIED|ERROR|ESTOP|FAILED|STOP|TORQUE", event.name)]
    digest = hashlib.sha256()
    seen: dict[str, int] = {}
    for number in range(_SEQUENCES):
        state, time_s = ModeState(), 0.0
        course = list(_TO_SPEED) if number % 2 else []
        events = quiet if number % 4 == 3 else every
        course += [events[each] for each in rng.integers(len(events), size=_EVENTS)]
        for event in course:
            time_s += float(rng.choice([0.02, 0.5, 4.0, 11.0, -1.0], p=[0.5, 0.3, 0.1, 0.08, 0.02]))
            check = list(Check)[int(rng.integers(1, len(Check)))] if event is Event.CHECKS_FAILED else Check.NONE
            state, actions = step_modes(state, ModeEvent(event, time_s, check))
            told = [event.name, state.mode.name, *(action.name for action in actions)]
            told += [state.inhibit.name, inhibit_of(state).name, state.failed_check.name, str(int(state.faults))]
            digest.update((" ".join(told) + "\n").encode())
            seen[state.mode.name] = seen.get(state.mode.name, 0) + 1
    return {"sha256": digest.hexdigest(), "steps_in_mode": seen}


def sequences() -> dict[str, object]:
    """All of them."""
    return {"limiter": limiter_digest(), "skid_limiter": skid_limiter_digest(), "modes": modes_digest()}
