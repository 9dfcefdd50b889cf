"""The calibration of a stepped-frequency radar ``X.radar.h5``: look-up, and gain and delay of each channel.

Its contents are those of a ``SweepRecording``. It replaces the look-up that a radar records itself.
"""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.drive import SweepRecording
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import (
    attribute_of,
    create_store,
    open_store,
    reading,
    validate_store,
    write_array,
    write_attribute,
)

_SCHEMA = load_schema("radar")
_SAME_HZ, _SAME_NS = 500.0, 2e-3
"""Half a step of the frequencies of a radar's message, and two of its delays."""


class SweepLayout(NamedTuple):
    """Properties that sweeps and their calibration share.

    Attributes:
        channels: number of channels, without the calibration channel.
        frequencies_hz: frequencies of the steps.
        group_delay_ns: delay of the calibration channel's path.
    """

    channels: int
    frequencies_hz: Float[np.ndarray, " frequency"]
    group_delay_ns: float

    def __str__(self) -> str:
        low, high = self.frequencies_hz[[0, -1]] / 1e6
        steps = f"{len(self.frequencies_hz)} steps from {low:.6g} to {high:.6g} MHz"
        return f"{self.channels} channels, {steps}, calibration path of {self.group_delay_ns:.4g} ns"

    def agrees(self, other: "SweepLayout") -> bool:
        """Whether both describe the same sweeps."""
        return (
            (self.channels, len(self.frequencies_hz)) == (other.channels, len(other.frequencies_hz))
            and bool(np.all(np.abs(self.frequencies_hz - other.frequencies_hz) <= _SAME_HZ))
            and abs(self.group_delay_ns - other.group_delay_ns) <= _SAME_NS
        )


def write_radar_calibration(
    path: str | Path, known: SweepRecording, provenance: dict[str, object], *, force: bool = False
) -> None:
    """Write ``X.radar.h5``.

    Raises:
        InputError: the output exists (without ``force``), cannot be written, or the contents violate the schema.
    """
    channels = len(known.lookup_sweeps)
    arrays = {
        **{name: getattr(known, name) for name in ("frequencies_hz", "lookup_sweeps", "lookup_calibration_sweep")},
        "channel_valid": np.ones(channels, bool) if known.channel_valid is None else known.channel_valid,
        "channel_gain": known.channel_gain,
        "channel_delay_ns": known.channel_delay_ns,
    }
    with create_store(path, _SCHEMA, force) as (store, _):
        write_attribute(store, "name", Path(path).name.removesuffix(_SCHEMA.suffix))
        write_attribute(store, "group_delay_ns", float(known.group_delay_ns))
        write_attribute(store, "provenance", json.dumps(provenance))
        for name, values in arrays.items():
            if values is not None:
                write_array(store, _SCHEMA, f"/{name}", values)
        for finding in validate_store(store, path, _SCHEMA):
            raise finding.error()


def read_radar_calibration(
    path: str | Path,
    used_for: SweepLayout | None = None,
    *,
    gain: Float[np.ndarray, " channel"] | None = None,
    delay_ns: Float[np.ndarray, " channel"] | None = None,
) -> SweepRecording:
    """Read ``X.radar.h5``.

    Args:
        path: path of the file.
        used_for: layout of the sweeps to be calibrated.
        gain, delay_ns: gain and delay of each channel, used if the file has none.

    Raises:
        InputError: the file cannot be read, violates the schema, its calibration sweep has zeros, or it is of sweeps
            of another layout.
    """
    with open_store(path) as store, reading(path, "file"):
        for finding in validate_store(store, path, _SCHEMA):
            raise finding.error()
        held = {entry.path[1:]: store[entry.path][:] for entry in _SCHEMA.datasets if entry.path in store}
        group_delay_ns = float(np.float64(attribute_of(store, "group_delay_ns")))  # type: ignore[arg-type]  # validated
    held["channel_valid"] = held["channel_valid"].astype(bool)
    known = SweepRecording(**{"channel_gain": gain, "channel_delay_ns": delay_ns} | held, group_delay_ns=group_delay_ns)
    if not np.all(known.lookup_calibration_sweep):
        zeros = f"{np.count_nonzero(known.lookup_calibration_sweep == 0)} zeros"
        raise InputError(path, "/lookup_calibration_sweep", "non-zero values", zeros)
    own = SweepLayout(len(known.lookup_sweeps), known.frequencies_hz, group_delay_ns)
    if used_for is not None and not own.agrees(used_for):
        raise InputError(path, "sweeps", f"{used_for}, as the sweeps to calibrate", str(own))
    return known
