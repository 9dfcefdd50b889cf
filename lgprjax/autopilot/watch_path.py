"""How far the vehicle is off its path while it is driven by the autopilot. Fault 31."""

from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import Dwell, beyond, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch

FOOT_M = 0.3048
FAR_M = 3 * FOOT_M
OFF_S = 0.06
"""Found within 0.1 s."""
BACK_S = 1.0


class PathWatchState(NamedTuple):
    """What is carried from tick to tick: the vehicle has been on the path since it was engaged; findings."""

    arrived: bool = False
    off: Dwell = Dwell()
    far: Dwell = Dwell()


def step_path_watch(
    state: PathWatchState, *, engaged: bool, cross_track_m: float, step_s: float
) -> tuple[PathWatchState, Watch]:
    """State and findings of a tick.

    From engaging up to where the vehicle first is within a foot of the path it is on its way there, and nothing is
    found but an offset that is no number.

    Args:
        state: of the last tick.
        engaged: the autopilot steers.
        cross_track_m: offset from the path.
        step_s: since the last tick.
    """
    if not engaged:
        return PathWatchState(), Watch(0)
    step_s = counted_step_s(step_s)
    offset = abs(cross_track_m)
    arrived = state.arrived or offset <= FOOT_M
    known = offset >= 0.0
    off = step_dwell(state.off, arrived and beyond(offset, FOOT_M), step_s, on_s=OFF_S, off_s=BACK_S)
    far = step_dwell(state.far, not known or (arrived and offset > FAR_M), step_s, on_s=OFF_S, off_s=BACK_S)
    return PathWatchState(arrived, off, far), as_watch(off.on * Watch.OFF_PATH | far.on * Watch.FAR_OFF_PATH)
