"""What a stepped-frequency drive log says of its receiver: frequencies, look-up, and each channel's gain and delay."""

import jax.numpy as jnp
import numpy as np

from lgprjax.formats import SweepRecording
from lgprjax.radar import ChannelResponse, LookUp, calibrate_sweeps, estimate_channel_response, find_dead_channels
from lgprjax.scene import SimulatedDrive, SweepPlan, start_of_day


def describe_sweeps(drive: SimulatedDrive, plan: SweepPlan) -> SweepRecording:
    """The recording of a drive's sweeps, from what is recorded at the start of its day.

    As in the field: the array in empty space is the look-up, and gains and delays are measured over a metal plate,
    noise included; the truth about the channels stays in the scene.
    """
    start = start_of_day(plan, drive.radar, drive.response, drive.day.noise_field, drive.day.seed)
    frequencies_hz = plan.frequency_mhz * 1e6
    channels = len(start.empty)
    plate, _ = calibrate_sweeps(
        jnp.asarray(start.plate[None]),
        jnp.asarray(start.plate_calibration[None]),
        LookUp(jnp.asarray(start.empty), jnp.asarray(start.empty_calibration)),
        ChannelResponse(jnp.ones(channels), jnp.zeros(channels)),
        jnp.asarray(frequencies_hz, jnp.float32),
    )
    dead = find_dead_channels(
        np.stack([start.empty, start.plate]), np.stack([start.empty_calibration, start.plate_calibration])
    )
    response = estimate_channel_response(np.asarray(plate[0]), frequencies_hz, dead)
    return SweepRecording(
        frequencies_hz=frequencies_hz,
        lookup_sweeps=start.empty,
        lookup_calibration_sweep=start.empty_calibration,
        group_delay_ns=plan.calibration_delay_ns,
        channel_gain=np.asarray(response.gain, np.float64),
        channel_delay_ns=np.asarray(response.delay_ns, np.float64),
    )
