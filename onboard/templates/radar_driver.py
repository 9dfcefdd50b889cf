"""A stepped-frequency radar on the line of the onboard runtime: a template.

    python onboard/templates/radar_driver.py 5001 DRIVE.drive.h5

``Radar`` plays the sweeps of a drive log where a device would be read: put your device's calls into its methods. A unit
of finished traces (GSSI, IDS, ImpulseRadar) sends ``radar_description`` instead of the two descriptions, and
``radar_scan`` instead of ``radar_sweep``: docs/onboard.md, *A radar of one's own*.
"""

import sys
import time

import numpy as np
from line import Line

from lgprjax.formats import DriveLog, SweepRecording

STOP, START, CALIBRATE, LOOK_UP = range(4)
IDLE, SCANNING, CALIBRATING, LOOKING_UP = range(4)
WIDTH = 8
"""Bytes of a complex number: 8 for f32, 4 for i16, which halves the line and adds noise of half a count."""


class Radar:
    """The device.

    Args:
        path: drive log whose sweeps are played, at the pace at which they were recorded, again and again.
    """

    def __init__(self, path: str) -> None:
        self._log = DriveLog.open(path)
        recording = self._log.description.recording
        if not isinstance(recording, SweepRecording):
            raise SystemExit(f"{path}: expected a drive log of sweeps, found traces")
        self.recording = recording
        self.channels = len(recording.lookup_sweeps)
        self.period_s = float(np.median(np.diff(self._log.scan_time_s)))
        self.lookup = np.concatenate([recording.lookup_sweeps, recording.lookup_calibration_sweep[None]])

    def calibrate(self) -> None:
        """Measure the attenuator path; what it finds is sent with every sweep, as its calibration channel."""

    def look_up(self) -> None:
        """Measure with the array pointed at empty space; the result is ``lookup``."""

    def sweep(self, number: int) -> tuple[np.ndarray, int]:
        """The next scan: complex [channel, step] with the calibration channel last, and bits of channels with data."""
        at = number % self._log.scans
        sweeps, calibration, valid = self._log.read_sweeps(at, at + 1)
        bits = sum(1 << channel for channel in range(self.channels) if valid[0, channel])
        return np.concatenate([sweeps[0], calibration]), bits


def packed(rows: np.ndarray) -> dict[str, float | bytes]:
    """Fields of radar_sweep and radar_lookup that hold complex numbers."""
    parts = np.stack([rows.real, rows.imag], axis=-1)
    scale = 1.0 if WIDTH == 8 else max(float(np.abs(parts).max()), 1e-30) / 32767.0
    data = parts.astype("<f4") if WIDTH == 8 else np.round(parts / scale).astype("<i2")
    return {"rows": rows.shape[0], "steps": rows.shape[1], "width": WIDTH, "scale": scale, "data": data.tobytes()}


def main() -> None:
    """Serve until Ctrl-C."""
    radar, line = Radar(sys.argv[2]), Line("radar", int(sys.argv[1]))
    frequencies = radar.recording.frequencies_hz
    period_ns = round(1e9 * radar.period_s)
    state, number, dropped, begun_ns = IDLE, 0, 0, 0
    told_ns = healthy_ns = 0
    while True:
        for frame, _ in line.take():
            if frame.name != "radar_command":
                continue  # radar_sweep_plan: takes effect at the next start, where the device has a choice
            action = int(frame.number("action"))
            if action == START and state != SCANNING:
                state, number, begun_ns = SCANNING, 0, time.monotonic_ns()
            elif action == STOP:
                state = IDLE
            elif action == CALIBRATE and state == IDLE:
                radar.calibrate()
            elif action == LOOK_UP and state == IDLE:
                radar.look_up()
        now_ns = time.monotonic_ns()
        if now_ns - told_ns >= 1_000_000_000:
            told_ns = now_ns
            line.send(
                "radar_sweep_description",
                channels=radar.channels,
                steps=len(frequencies),
                first_khz=round(frequencies[0] / 1e3),
                step_khz=round((frequencies[1] - frequencies[0]) / 1e3),
                group_delay_ps=round(1e3 * radar.recording.group_delay_ns),
                scan_period_us=round(1e6 * radar.period_s),
            )
            line.send("radar_lookup", **packed(radar.lookup))
        if now_ns - healthy_ns >= 100_000_000:
            healthy_ns = now_ns
            line.send("radar_health", state=state, errors=0, temperature_c=35.0, dropped=dropped)
        # A scan is sent when it is done; its stamp is its beginning.
        while state == SCANNING and begun_ns + (number + 1) * period_ns <= now_ns:
            rows, bits = radar.sweep(number)
            line.send("radar_sweep", begun_ns + number * period_ns, scan=number, valid=bits, **packed(rows))
            number += 1
        time.sleep(0.001)


if __name__ == "__main__":
    main()
