"""What the recording of a run tells of the way from a scan to a command."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

if TYPE_CHECKING:
    from lgprjax.report import TimingPicture

ENGAGED = (3, 4)
"""Modes in which the vehicle steers itself."""
COMMAND_MS = 100.0
"""From a scan's start to the command that it leads to, at most."""
_MOVING_MPS = 0.1


class RunRecords(NamedTuple):
    """Records of a run; times in nanoseconds of the computer's monotonic clock.

    Attributes:
        scans: that arrived from the radar.
        tick_ns: begins of the control loop's ticks.
        plans, plan_ns: what the ticks decided (``runtime.records.PLAN``), and when.
        fixes, fix_ns: of the scans that were searched (``runtime.records.FIX``), and when each was ready.
        used_ns: of every command with a fix, the start of its scan and the begin of its tick.
        memory: seconds, and MB of all processes together.
    """

    scans: int
    tick_ns: Int[np.ndarray, " tick"]
    plans: np.ndarray
    plan_ns: Int[np.ndarray, " plan"]
    fixes: np.ndarray
    fix_ns: Int[np.ndarray, " fix"]
    used_ns: Int[np.ndarray, "used 2"]
    memory: Float[np.ndarray, "moment 2"]

    @property
    def period_ms(self) -> Float[np.ndarray, " step"]:
        """From tick to tick."""
        return np.asarray(np.diff(self.tick_ns) / 1e6)

    @property
    def fix_ms(self) -> Float[np.ndarray, " fix"]:
        """From a scan's start to its fix, while tracking."""
        scan_ns = self.fixes["scan_ns"]
        return np.asarray((self.fix_ns - scan_ns)[self.tracking(scan_ns)] / 1e6)

    @property
    def command_ms(self) -> Float[np.ndarray, " command"]:
        """From a scan's start to the begin of the tick that commands with its fix, while tracking."""
        scan_ns, begin_ns = self.used_ns.T
        return np.asarray((begin_ns - scan_ns)[self.tracking(scan_ns)] / 1e6)

    def tracking(self, time_ns: Int[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
        """Whether the vehicle was engaged and moving: what is told of the search is told of tracking."""
        if not len(self.plans):
            return np.zeros(len(time_ns), bool)
        on = np.isin(self.plans["mode"], ENGAGED) & (np.abs(self.plans["speed_mps"]) > _MOVING_MPS)
        return np.asarray(on[np.clip(np.searchsorted(self.plan_ns, time_ns), 0, len(on) - 1)])


def read_records(folder: Path) -> RunRecords:
    """Records of a run's folder.

    Raises:
        InputError: there is no recording in it.
    """
    from lgprjax.formats import read_run
    from lgprjax.runtime.records import FIX, PLAN, Kind, Source, fix_row, unpack

    begun: dict[int, int] = {}
    ticks, plan_ns, fix_ns = [], [], []
    plans, fixes = [], []
    used: list[tuple[int, int]] = []
    memory: list[tuple[float, float]] = []
    scans = 0
    for _, data in read_run(folder):
        record = unpack(data)
        if record.kind is Kind.TICK:
            begun[record.tick] = record.mono_ns
            ticks.append(record.mono_ns)
        elif record.kind is Kind.PLAN:
            plans.append(np.frombuffer(record.payload, PLAN)[0])
            plan_ns.append(record.mono_ns)
        elif record.kind is Kind.FIX and record.tick == 0:
            fixes.append(fix_row(record.payload))
            fix_ns.append(record.mono_ns)
        elif record.kind is Kind.FIX:
            used.append((int(fix_row(record.payload)["scan_ns"]), record.tick))
        elif record.kind is Kind.PORT_IN and record.source is Source.RADAR:
            scans += record.payload[3] == 0x12
        elif record.kind is Kind.MONITOR and record.tick > 0:
            held = [value for value in json.loads(record.payload).get("rss_mb", {}).values() if value is not None]
            memory.append((record.mono_ns / 1e9, float(sum(held))))
    return RunRecords(
        scans,
        np.array(ticks, np.int64),
        np.array(plans, PLAN),
        np.array(plan_ns, np.int64),
        np.array(fixes, FIX),
        np.array(fix_ns, np.int64),
        np.array([(scan_ns, begun[tick]) for scan_ns, tick in used if tick in begun], np.int64).reshape(-1, 2),
        np.array(memory, np.float64).reshape(-1, 2),
    )


def timing_of(records: RunRecords, title: str) -> "TimingPicture":
    """Times of a run as the record that its picture is made from."""
    from lgprjax.report import StageTimes, TimingPicture

    return TimingPicture(
        title=title,
        stages=(
            StageTimes("scan to fix", records.fix_ms),
            StageTimes("scan to command", records.command_ms, COMMAND_MS),
            StageTimes("control period", records.period_ms),
        ),
        note=(
            f"{records.scans} scans, {len(records.fixes)} searched. A scan counts from its start, a command from its "
            "tick's begin; both while engaged and moving, the control period always."
        ),
    )
