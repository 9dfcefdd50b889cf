"""The mode machine at work: events in, and what its actions leave switched on."""

from typing import NamedTuple

from lgprjax.autopilot import Action, Event, Happening, Mode, ModeState, step_modes
from lgprjax.autopilot.mode_events import Check

STEERING, PEDALS, CUT = 1, 2, 4
"""Bits of ``engage`` in a drive_command."""


class Happened(NamedTuple):
    """An event that changed something, for the recording: what it was, the mode after it, and the actions."""

    event: str
    mode: str
    actions: tuple[str, ...]


class ModeKeeper:
    """The state of the modes and the switches that its actions move.

    Args:
        after_death: this control process replaces one that died: an error stands until it is up, and only the override
            button leaves it.

    Attributes:
        state: of the mode machine.
        engage: bits of the drive_command.
        stopping: a controlled stop runs.
        set_speed_mps: that the operator locked.
        lit: the controller's light.
        checks_asked: the system checks are to be run.
        since_s: when the mode was entered.
    """

    def __init__(self, *, after_death: bool, speed_step_mps: float) -> None:
        self.state = ModeState()
        self.engage = 0
        self.stopping = False
        self.set_speed_mps = 0.0
        self.lit = False
        self.checks_asked = False
        self.since_s = 0.0
        self._step_mps = speed_step_mps
        if after_death:
            self.state = step_modes(self.state, Happening(Event.CONTROL_DIED, 0.0))[0]
            self.lit = True

    @property
    def mode(self) -> Mode:
        """As driven."""
        return self.state.mode

    def cut(self) -> None:
        """An emergency that a watch found: the box cuts the power and brakes, until the operator leaves the error."""
        self.engage = CUT

    def tell(self, event: Event, time_s: float, speed_mps: float, *, check: Check = Check.NONE) -> Happened | None:
        """An event; what it changed, ``None`` where nothing.

        Args:
            event: what happens.
            time_s: monotonic.
            speed_mps: of the vehicle, which a cruise button locks.
            check: that failed.
        """
        before = self.state
        self.state, actions = step_modes(before, Happening(event, time_s, check))
        for action in actions:
            self._act(action, speed_mps)
        if self.state.mode is not before.mode:
            self.since_s = time_s
            if before.mode is Mode.ERROR and self.state.mode is not Mode.EMERGENCY_STOP:
                self.engage &= ~CUT
        if not actions and self.state._replace(time_s=0.0) == before._replace(time_s=0.0):
            return None
        return Happened(event.name, self.state.mode.name, tuple(action.name for action in actions))

    def _act(self, action: Action, speed_mps: float) -> None:
        match action:
            case Action.RUN_CHECKS:
                self.checks_asked = True
            case Action.RELEASE_ACTUATORS:
                self.engage &= CUT
                self.stopping = False
            case Action.RELEASE_PEDALS:
                self.engage &= ~PEDALS
            case Action.ENGAGE_STEERING:
                self.engage |= STEERING
            case Action.ENGAGE_SPEED:
                self.engage |= PEDALS
            case Action.LOCK_SPEED:
                self.set_speed_mps = max(speed_mps, self._step_mps)
            case Action.RAISE_SPEED:
                self.set_speed_mps += self._step_mps
            case Action.LOWER_SPEED:
                self.set_speed_mps = max(self.set_speed_mps - self._step_mps, 0.0)
            case Action.STOP_CONTROLLED:
                self.stopping = True
                # The autopilot has the brake in STEERING, too, until it hands over.
                self.engage |= PEDALS
            case Action.CUT_POWER:
                self.engage = CUT
            case Action.RESTORE_POWER:
                self.engage &= ~CUT
            case Action.LIGHT_BUTTON:
                self.lit = True
            case Action.DARKEN_BUTTON:
                self.lit = False
