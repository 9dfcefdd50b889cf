"""One recorded line as returned by vendor readers, and the vocabulary of importers' assumptions."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, Num

from lgprjax.errors import InputError


@dataclass(frozen=True)
class TraceCoordinates:
    """Recorded coordinates of each trace.

    Attributes:
        kind: ``degrees`` (x longitude, y latitude) or ``metres`` (x easting, y northing of a grid it does not name).
        x, y: the coordinates.
    """

    kind: Literal["degrees", "metres"]
    x: Float[np.ndarray, " trace"]
    y: Float[np.ndarray, " trace"]


@dataclass(frozen=True)
class Profile:
    """One line of traces; sample i is at travel time ``i * sample_interval_ns - time_zero_ns``.

    Attributes:
        path: source file.
        channels: signed samples, zero for no signal; several channels only from arrays.
        sample_interval_ns: two-way travel time between samples.
        time_zero_ns: time zero, relative to sample 0.
        spacing_m: distance between traces; ``None`` if unknown (recorded by time) or varying, in which case
            ``positions_m`` holds the positions.
        centre_frequency_hz: nominal centre frequency; ``None`` if unknown.
        positions_m: position of each trace from the headers; ``None`` if missing.
        metadata: further header values under the vendor's own names.
        coordinates: recorded position of each trace, if known.
        left_m, forward_m: position of each channel in the array, if known; falling from left to right.
        cut: description of the part read of a truncated file, such as ``120 of 199 traces``; ``None`` for a complete
            file.
        notes: contradictions between statements of the file and its contents, one line each.
    """

    path: Path
    channels: Num[np.ndarray, "trace channel sample"]
    sample_interval_ns: float
    time_zero_ns: float
    spacing_m: float | None
    centre_frequency_hz: float | None
    positions_m: Float[np.ndarray, " trace"] | None
    metadata: dict[str, object]
    coordinates: TraceCoordinates | None = None
    left_m: Float[np.ndarray, " channel"] | None = None
    forward_m: Float[np.ndarray, " channel"] | None = None
    cut: str | None = None
    notes: tuple[str, ...] = ()

    @property
    def traces(self) -> Num[np.ndarray, "trace sample"]:
        """Traces of the first channel, the only one of most files."""
        return self.channels[:, 0, :]

    @property
    def usual_step_m(self) -> float:
        """The header's spacing; of uneven positions the median step, 0 if there are none."""
        if self.spacing_m is not None or self.positions_m is None:
            return self.spacing_m or 0.0
        return float(np.median(np.abs(np.diff(self.positions_m))))

    def length_m(self, first: int, last: int) -> float:
        """Length between two traces by the header; 0 if it states none."""
        if self.spacing_m is not None or self.positions_m is None:
            return (self.spacing_m or 0.0) * (last - first)
        return float(np.sum(np.abs(np.diff(self.positions_m[first : last + 1]))))

    def by_channel(self) -> "list[Profile]":
        """Each channel as a separate line."""
        return [
            replace(self, channels=self.channels[:, c : c + 1], left_m=None, forward_m=None)
            for c in range(self.channels.shape[1])
        ]


def read_bytes(path: Path) -> bytes:
    """Whole file. Raises ``InputError`` when it is missing, unreadable or empty."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    if not data:
        raise InputError(path, "file", "data", "an empty file")
    return data


def companion(path: Path, suffix: str) -> Path:
    """The file of the same name with another suffix, in upper or lower case. Raises ``InputError`` if missing."""
    if not path.is_file():
        raise InputError(path, "file", "a readable file", "a folder" if path.is_dir() else "no such file")
    try:
        for candidate in sorted(path.parent.iterdir()):
            if candidate.stem == path.stem and candidate.suffix.lower() == suffix:
                return candidate
    except OSError:
        pass
    header = path.stem + (suffix.upper() if path.suffix.isupper() else suffix)
    raise InputError(path, "header file", f"{header} in the same folder", "none: copy it there")


def named_frequency_hz(antenna: str) -> float | None:
    """Centre frequency in an antenna's name, such as ``500 MHz shielded``; ``None`` if it has none."""
    # Bounded in every part: a damaged name may be thousands of digits.
    named = re.search(r"(?<![\d.])(\d{1,6}(?:\.\d{1,6})?)\s{0,3}MHz", antenna[:200], re.IGNORECASE | re.ASCII)
    return float(named[1]) * 1e6 or None if named else None


def count_traces(
    file: Path, data_bytes: int, trace_bytes: int, *, said: tuple[int, Path] | None, partial: bool
) -> tuple[int, str | None]:
    """Whole traces in a number of bytes, and ``Profile.cut`` if the file ends too early.

    Args:
        file: file of the traces.
        data_bytes: size of the traces after the headers; not above zero for none.
        trace_bytes: size of a trace, or of one trace of every channel if they are interleaved.
        said: number of traces stated in a header, and the file of that header.
        partial: whether to accept a file that ends too early, and count its whole traces.

    Raises:
        InputError: no trace is whole, the file holds more traces than the header states, or it ends too early without
            ``partial``.
    """
    whole, rest = divmod(max(data_bytes, 0), trace_bytes)
    if rest == 0 and whole and (said is None or said[0] == whole):
        return whole, None
    expected = ("a whole number" if whole else "at least one") if said is None else f"{said[0]} as {said[1].name} says"
    found = f"{whole} and a part of one" if whole and rest else "a part of one" if rest else f"{whole or 'none'}"
    # More traces than stated are no truncation: the header is another file's, or the samples are of another type.
    cut = whole > 0 and (said is None or whole < said[0])
    if not (cut and partial):
        raise InputError(
            file, "traces", expected, found + ("; read the whole ones with lgprjax import --partial" if cut else "")
        )
    return whole, f"{whole} of {f'at least {whole + 1}' if said is None else said[0]} traces"


def check_channel(file: Path, channel: int | None, channels: int) -> None:
    """Raise ``InputError`` for a channel that a file does not have; ``None`` is all of them."""
    if channel is not None and not 0 <= channel < channels:
        raise InputError(file, "--channel", f"0 to {channels - 1}" if channels > 1 else "0, its only one", str(channel))


# No quantity of a header is as large or, above zero, as small: such a value is damaged, and would overflow later.
_LARGEST, _SMALLEST = 1e12, 1e-12


class TextHeader:
    """Header of lines ``NAME separator VALUE``; returns values and refuses missing or invalid ones."""

    def __init__(self, path: Path, separator: str) -> None:
        self.path = path
        self.values: dict[str, str] = {}
        for line in read_bytes(path).decode("latin-1").splitlines():
            name, found, value = line.partition(separator)
            if found:
                self.values.setdefault(name.strip().upper(), value.strip())

    def number(self, name: str, *, default: float | None = None) -> float:
        """Value of a line, finite and of possible size; ``default`` replaces only a missing line."""
        text = self.values.get(name)
        if text is None and default is not None:
            return default
        try:
            value = float(text or "")
        except ValueError:
            value = np.nan
        if not abs(value) <= _LARGEST:
            # A damaged value may be long; the message must stay readable.
            raise InputError(self.path, name, "a number", "none" if text is None else repr(text[:40]))
        return value

    def positive(self, name: str) -> float:
        """Value above zero."""
        value = self.number(name)
        if value < _SMALLEST:
            raise InputError(self.path, name, "a number above zero", f"{value:g}")
        return value

    def count(self, name: str) -> int:
        """Whole value above zero."""
        value = self.positive(name)
        if value != int(value):
            raise InputError(self.path, name, "a whole number", f"{value:g}")
        return int(value)


# Assumptions of an importer about quantities that no instrument recorded: ``assumed`` in a drive log's provenance.

Quantity = Literal[
    "time",
    "time zero",
    "speed",
    "odometry",
    "position",
    "place on the earth",
    "heading",
    "direction",
    "roll",
    "height",
    "position sigma",
    "heading sigma",
]
"""Quantities that may be assumed: the clock of the scans; time zero of their samples; the speed; travel; the path; its
place on the earth; the heading along it; which of its ends is the first; roll; height; and the sigmas of positions and
headings.
"""

Assumed = dict[Quantity, str]
"""The assumption for each quantity, in words."""


def assumed_of(provenance: Mapping[str, object]) -> dict[str, str]:
    """Assumptions of a drive log, or of a baseline of a map; empty if it states none."""
    found = provenance.get("assumed")
    # Recordings imported before this vocabulary existed hold numbers here.
    return {str(k): v for k, v in found.items() if isinstance(v, str)} if isinstance(found, dict) else {}


def assumed_in_words(assumed: Mapping[str, str]) -> str:
    """One line with each quantity and its assumption."""
    return ", ".join(f"{name} ({words})" for name, words in assumed.items())
