"""Commands of a calibration manoeuvre to steering and pedals, by time and by the vehicle's motion. No clock, no files.

The pedals' programme presses the brake before the throttle, and raises the throttle slowly until the brake has slowed
the vehicle by more than rolling does; only then is the throttle stepped.
"""

import math
from enum import Enum, auto

# Steering: steps to either side, then a sweep of rising frequency.

_STEP_SHARES, _STEP_S = (0.17, 0.5, 1.0), 3.0
_SWEEP_SHARE, _SWEEP_S, _SWEEP_HZ = 0.35, 40.0, (0.05, 1.0)
_FIRST_S = 1.0


class SteeringProgram:
    """Front angles over the time since steering was engaged.

    Args:
        amplitude_rad: angle of the largest step.
    """

    def __init__(self, amplitude_rad: float) -> None:
        self._steps = [(_FIRST_S, 0.0)]
        for share in _STEP_SHARES:
            self._steps += [(_STEP_S, sign * share * amplitude_rad) for sign in (1.0, -1.0, 0.0)]
        self._steps_s = sum(lasts_s for lasts_s, _ in self._steps)
        self._sweep_rad = _SWEEP_SHARE * amplitude_rad
        self._time_s = 0.0

    @property
    def share(self) -> float:
        """Completed share of the programme."""
        return min(self._time_s / (self._steps_s + _SWEEP_S + _STEP_S), 1.0)

    def restart(self) -> None:
        """Restart from the beginning, unless complete, because half a step is useless."""
        if self.share < 1.0:
            self._time_s = 0.0

    def step(self, step_s: float) -> float:
        """The angle of this tick, rad."""
        time_s, self._time_s = self._time_s, self._time_s + step_s
        for lasts_s, angle in self._steps:
            if time_s < lasts_s:
                return angle
            time_s -= lasts_s
        if time_s >= _SWEEP_S:
            return 0.0
        low_hz, high_hz = _SWEEP_HZ
        turns = low_hz * time_s + 0.5 * (high_hz - low_hz) * time_s**2 / _SWEEP_S
        return self._sweep_rad * math.sin(math.tau * turns)


# Pedals: a throttle that rises until the vehicle moves, then to a brake that is proven, then runs between standstills.


class Phase(Enum):
    """Part of a run."""

    PROBE = auto()
    PRESS = auto()
    BACK = auto()
    COAST = auto()
    BRAKE = auto()
    EASE = auto()
    HALT = auto()
    REST = auto()
    STOP = auto()


_PROBE_PER_S, _MOST_PROBE, _MOVES_MPS = 0.03, 0.6, 0.25
_THROTTLES = (0.12, 0.18, 0.28, 0.15, 0.24, 0.33, 0.1, 0.21, 0.3, 0.16, 0.26, 0.14)
"""Throttle of each run, beyond the throttle at which the vehicle moved off."""
_BRAKES = (0.35, 0.5, 0.65, 0.42, 0.3, 0.58, 0.45, 0.33, 0.7, 0.38, 0.55, 0.48)
_BACK = 0.12
_HALT_BRAKE, _REST_BRAKE = 0.6, 0.4
_LASTS_S = {
    Phase.PROBE: 35.0,
    Phase.PRESS: 5.0,
    Phase.BACK: 1.5,
    Phase.COAST: 2.0,
    Phase.BRAKE: 0.7,
    Phase.EASE: 0.6,
    Phase.REST: 2.0,
}
_BRAKED = (Phase.BRAKE, Phase.EASE, Phase.HALT, Phase.REST, Phase.STOP)
_STANDS_MPS, _SLOW_MPS = 0.05, 0.6
_SMOOTHED_S, _ANSWER_S = 0.3, 0.6
"""Smoothing time of the speed for its rise, s, and time for which a released throttle still pushes, s."""
_PROVING_MPS, _UNPROVEN_MPS = 1.2, 2.0
"""Speed from which the brake is proven, and which the vehicle never exceeds before."""
_MOST_BRAKING_MPS2 = 8.0
"""A speed that falls faster is not the vehicle's."""
LEAST_BRAKING_MPS2 = 0.4
"""Least deceleration by a proven brake, in addition to rolling."""
_OVER_MPS = 1.0
_SLOWS_S, _SLOWS_MPS = 2.0, 0.5
"""Time in which a pressed brake slows the vehicle by this speed, or to standstill."""


class PedalProgram:
    """Throttle and brake commands by the vehicle's motion.

    Args:
        fastest_mps: speed at which the throttle is released once the brake is proven.

    Attributes:
        runs: number of completed runs; -2 before the vehicle has moved, -1 before the brake is proven.
        proven: whether the brake has been observed to act.
        dead: whether the brake has been pressed without effect.
        trouble: reason why the programme cannot continue; empty if it can.
    """

    def __init__(self, fastest_mps: float) -> None:
        self.runs, self.proven, self.dead, self.trouble = -2, False, False, ""
        self._fastest_mps = fastest_mps
        self._phase, self._time_s = Phase.REST, 0.0
        self._throttle, self._moved_at = 0.0, math.inf
        self._smooth_mps, self._coasted_mps, self._coasting_mps2 = 0.0, 0.0, 0.0
        self._braked_mps, self._braked_s = 0.0, 0.0

    @property
    def share(self) -> float:
        """Completed share of the runs."""
        return max(self.runs, 0) / len(_THROTTLES)

    @property
    def cap_mps(self) -> float:
        """Speed at which the throttle is released now."""
        return self._fastest_mps if self.proven else _PROVING_MPS

    @property
    def limit_mps(self) -> float:
        """Speed beyond which something is wrong."""
        return self._fastest_mps + _OVER_MPS if self.proven else _UNPROVEN_MPS

    @property
    def between_runs(self) -> bool:
        """Whether the vehicle is, and is to stay, at standstill."""
        return self._phase is Phase.REST

    def restart(self) -> None:
        """The run begins again, from standstill."""
        self._go(Phase.REST)
        self._braked_s = 0.0

    def step(self, speed_mps: float, step_s: float, *, stop: bool = False) -> tuple[float, float]:
        """Throttle and brake of this tick, 0 to 1.

        Args:
            speed_mps: forward speed by the wheels; NaN stops.
            step_s: time since the last tick.
            stop: whether to brake until the next ``restart``.
        """
        self._time_s += step_s
        if stop or not math.isfinite(speed_mps):
            self._go(Phase.STOP)
        else:
            self._smooth_mps += min(step_s / _SMOOTHED_S, 1.0) * (speed_mps - self._smooth_mps)
            self._advance(speed_mps, step_s)
        self._watch_brake(speed_mps, step_s)
        run = min(max(self.runs, 0), len(_BRAKES) - 1)
        throttle, brake = self._moved_at + _THROTTLES[run], _BRAKES[run]
        return {
            Phase.PROBE: (self._throttle, 0.0),
            Phase.PRESS: (throttle, 0.0),
            Phase.BACK: (max(throttle - _BACK, 0.0), 0.0),
            Phase.COAST: (0.0, 0.0),
            Phase.BRAKE: (0.0, brake),
            Phase.EASE: (0.0, max(brake - _BACK, 0.0)),
            Phase.HALT: (0.0, _HALT_BRAKE),
            Phase.REST: (0.0, _REST_BRAKE),
            Phase.STOP: (0.0, _HALT_BRAKE),
        }[self._phase]

    def _advance(self, speed_mps: float, step_s: float) -> None:
        phase, over = self._phase, self._time_s >= _LASTS_S.get(self._phase, math.inf)
        rises_mps2 = (speed_mps - self._smooth_mps) / _SMOOTHED_S
        coming_mps = speed_mps + max(rises_mps2, 0.0) * _ANSWER_S
        if speed_mps < -_MOVES_MPS:
            self._fail("the vehicle rolls backward: level ground is needed")
        elif phase is Phase.REST and abs(speed_mps) >= _STANDS_MPS:
            self._time_s = 0.0
        elif phase is Phase.REST and over:
            self._throttle = 0.0
            self._go(Phase.PRESS if self.proven else Phase.PROBE)
        elif phase is Phase.PROBE:
            self._probe(speed_mps, coming_mps, step_s, over=over)
        elif phase is Phase.PRESS and over and speed_mps < _MOVES_MPS:
            self._fail(f"the vehicle does not move at a throttle of {self._moved_at + _THROTTLES[self.runs]:.2f}")
        elif phase is Phase.PRESS and (over or coming_mps >= self.cap_mps):
            self._go(Phase.BACK)
        elif phase is Phase.BACK and (over or coming_mps >= self.cap_mps + 0.5):
            self._go(Phase.COAST)
        elif phase is Phase.COAST and (over or speed_mps < _SLOW_MPS or speed_mps >= self.cap_mps + 0.2):
            self._coasted_mps, self._coasting_mps2 = speed_mps, max(-rises_mps2, 0.0)
            # A brake that has not been seen to act is not eased.
            self._go(Phase.BRAKE if self.proven else Phase.HALT)
        elif phase in (Phase.BRAKE, Phase.EASE, Phase.HALT) and abs(speed_mps) < _STANDS_MPS:
            self._stand()
        elif phase in (Phase.BRAKE, Phase.EASE) and over:
            self._go(Phase.EASE if phase is Phase.BRAKE else Phase.HALT)

    def _probe(self, speed_mps: float, coming_mps: float, step_s: float, *, over: bool) -> None:
        self._throttle = min(self._throttle + _PROBE_PER_S * step_s, _MOST_PROBE)
        moves, first = speed_mps > _MOVES_MPS, self.runs < -1
        if moves:
            # The first time it may have left a kerb, or a parking brake.
            self._moved_at = min(self._moved_at, self._throttle)
        if moves and first:
            self._go(Phase.HALT)
        elif coming_mps >= _PROVING_MPS:
            self._go(Phase.COAST)
        elif over or (self._throttle >= _MOST_PROBE and not moves):
            wanted_mps = _MOVES_MPS if first else _PROVING_MPS
            self._fail(f"the vehicle does not reach {wanted_mps:g} m/s at a throttle of {_MOST_PROBE:g}")

    def _stand(self) -> None:
        """A run ends; the second one proves the brake."""
        if self.runs == -1:
            slowed_mps2 = self._coasted_mps / self._time_s
            if not self._coasting_mps2 + LEAST_BRAKING_MPS2 < slowed_mps2 < _MOST_BRAKING_MPS2:
                self._fail("the brake has not been seen to slow the vehicle")
                return
            self.proven = True
        self.runs += 1
        self._go(Phase.REST)

    def _watch_brake(self, speed_mps: float, step_s: float) -> None:
        if self._phase not in _BRAKED:
            self._braked_s = 0.0
            return
        if self._braked_s == 0.0:
            self._braked_mps = speed_mps
        self._braked_s += step_s
        if self._braked_s < _SLOWS_S:
            return
        self._braked_s = 0.0
        if abs(speed_mps) > max(abs(self._braked_mps) - _SLOWS_MPS, _MOVES_MPS):
            self.dead = True
            self._fail("the brake does not slow the vehicle")

    def _fail(self, why: str) -> None:
        self.trouble = why
        self._go(Phase.STOP)

    def _go(self, phase: Phase) -> None:
        self._phase, self._time_s = phase, 0.0
