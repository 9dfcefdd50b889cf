"""The mode machine in the control loop: events in, actions out; the checks that allow engaging."""

from collections.abc import Callable
from typing import NamedTuple

from lgprjax.autopilot import Action, Check, Event, Mode, ModeEvent, ModeState, step_modes

STEERING, PEDALS, CUT = 1, 2, 4
"""Bits of ``engage`` in a drive_command."""


class ModeChange(NamedTuple):
    """An event that changed something, for the recording: its name, the mode after it, and the actions."""

    event: str
    mode: str
    actions: tuple[str, ...]


class ModeKeeper:
    """The state of the modes and the switches set by their actions.

    Args:
        after_death: whether this control process replaces a dead one: an error holds until it is up, and only the
            override button leaves it.
        speed_step_mps: speed step of the cruise buttons.
        speed_control: whether the autopilot has throttle and brake.

    Attributes:
        state: state of the mode machine.
        engage: bits of the drive_command.
        stopping: whether a controlled stop runs.
        set_speed_mps: speed locked by the operator.
        lit: whether the controller's light is on.
        checks_requested: whether the system checks are requested.
        since_s: time at which the mode was entered.
    """

    def __init__(self, *, after_death: bool, speed_step_mps: float, speed_control: bool = True) -> None:
        self.state = ModeState(speed_control=speed_control)
        self.engage = 0
        self.stopping = False
        self.set_speed_mps = 0.0
        self.lit = False
        self.checks_requested = False
        self.since_s = 0.0
        self._step_mps = speed_step_mps
        if after_death:
            self.state = step_modes(self.state, ModeEvent(Event.CONTROL_DIED, 0.0))[0]
            self.lit = True

    @property
    def mode(self) -> Mode:
        """Present mode."""
        return self.state.mode

    def cut(self) -> None:
        """Cut for an emergency found by a watch: the box cuts the power and brakes, until the operator leaves the
        error.
        """
        self.engage = CUT

    def tell(self, event: Event, time_s: float, speed_mps: float, *, check: Check = Check.NONE) -> ModeChange | None:
        """Apply an event; returns the change, ``None`` without one.

        Args:
            event: event to apply.
            time_s: monotonic time.
            speed_mps: speed of the vehicle, locked by a cruise button.
            check: failed check.
        """
        before = self.state
        self.state, actions = step_modes(before, ModeEvent(event, time_s, check))
        for action in actions:
            self._act(action, speed_mps)
        if self.state.mode is not before.mode:
            self.since_s = time_s
            if before.mode is Mode.ERROR and self.state.mode is not Mode.EMERGENCY_STOP:
                self.engage &= ~CUT
        if not actions and self.state._replace(time_s=0.0) == before._replace(time_s=0.0):
            return None
        return ModeChange(event.name, self.state.mode.name, tuple(action.name for action in actions))

    def _act(self, action: Action, speed_mps: float) -> None:
        match action:
            case Action.RUN_CHECKS:
                self.checks_requested = True
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
                self.set_speed_mps = speed_mps
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


# System checks: conditions for engaging, tried for a while and then reported.

_PATIENCE_S = 12.0
_BRAKE_TEST_EVERY_S = 2.0


class CheckItem(NamedTuple):
    """One check: its name, whether it holds now, and why not."""

    check: Check
    good: bool
    reason: str


class SystemChecks:
    """A run of the checks: passed as soon as all hold, failed by the first that does not hold after a timeout.

    Attributes:
        items: results of the last evaluation, in the order of the checks.
        running: whether a run is under way.
    """

    def __init__(self) -> None:
        self.items: list[CheckItem] = []
        self.running = False
        self._began_s = 0.0
        self._braked_s = 0.0

    def begin(self, time_s: float) -> None:
        """Begin, or restart."""
        self.running, self._began_s, self._braked_s = True, time_s, 0.0

    def step(self, time_s: float, look: Callable[[], list[CheckItem]], *, starting: bool) -> CheckItem | bool | None:
        """``True`` if the run has passed, the failed item if it failed, ``None`` while it continues.

        While processes are still ``starting`` for the first time no check fails; the supervisor limits their time.
        """
        if not self.running:
            return None
        if starting:
            self._began_s = time_s
        self.items = look()
        failed = next((item for item in self.items if not item.good), None)
        if failed is None:
            self.running = False
            return True
        if time_s - self._began_s < _PATIENCE_S:
            return None
        self.running = False
        return failed

    def brake_test_due(self, time_s: float) -> bool:
        """Whether to request the box's braking test now."""
        waiting = self.running and any(item.check is Check.BRAKE and not item.good for item in self.items)
        if not waiting or time_s - self._braked_s < _BRAKE_TEST_EVERY_S:
            return False
        self._braked_s = time_s
        return True
