"""SEG-Y lines written by radars."""

import struct
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int, Num, UInt32

from lgprjax.errors import InputError
from lgprjax.formats.line_layout import inputs_of, write_lines, write_positioned_lines
from lgprjax.formats.line_positions import metres_kind
from lgprjax.formats.plausible import ASTRAY, left_out_in_words, plausible_places, plausible_positions
from lgprjax.formats.profile import Profile, TraceCoordinates, count_traces, read_bytes
from lgprjax.formats.survey_track import (
    UNUSED_PLACE,
    SurveyOrigin,
    check_utm,
    path_lengths_m,
    time_zero_assumed,
    travel_along_path,
    unused_zone,
    utm_projection,
)

_TEXT_BYTES, _BINARY_BYTES, _TRACE_HEADER_BYTES = 3200, 400, 240
# Stored and returned type by the format code. Those of 1 and 5 are floats of four bytes, IBM's and IEEE's.
_FORMATS = {1: ("u4", "f4"), 2: ("i4", "i4"), 3: ("i2", "i2"), 5: ("u4", "f4"), 8: ("i1", "i2")}
SampleFormat = Literal["ibm", "ieee"]
_FLOATS: dict[int, SampleFormat] = {1: "ibm", 5: "ieee"}
# Major and minor revision; a program that writes both as one number of two bytes may swap them.
_REVISIONS = ((0, 0), (1, 0), (2, 0), (2, 1))
# First bytes, counted from 1 as in the standard, and types of the words read from every trace header.
_TRACE_WORDS = {71: "i2", 89: "i2", 115: "u2", 117: "u2", **dict.fromkeys((73, 77, 81, 85, 181, 185), "i4")}
# A header word of microseconds cannot hold a radar's interval; radars' programs write picoseconds in it. Only words in
# this range are read as such: 0.01 ns (100 GHz) to 2 ns (Nyquist 250 MHz). Seismic defaults (4000) are outside.
_PLAUSIBLE_PS = (10, 2000)
_FOOT_M = 0.3048
# Marked IBM: more values than this share that no IBM float has. Marked IEEE: none among so many different ones, over so
# many powers of four.
_MISREAD, _DISTINCT, _EXPONENTS = 0.01, 1000, 3
# No grid counts farther from its origin.
_FARTHEST_M = 1e8
# Steps that vary by less than this share are even.
_EVEN = 0.02


def read_segy(
    path: str | Path,
    *,
    sample_interval_ns: float | None = None,
    time_zero_ns: float = 0.0,
    sample_format: SampleFormat | None = None,
    partial: bool = False,
) -> Profile:
    """Read one SEG-Y file of revision 0, 1 or 2, big- or little-endian; IBM or IEEE float, int32, int16 or int8.

    Extended text headers, additional trace headers, the offset of the first trace and data trailers are skipped as the
    binary header states them. The sample interval is, in this order: ``sample_interval_ns`` if given; the extended
    interval of revision 2; the interval word of the binary and trace headers, read as picoseconds, if they agree and it
    is from 10 to 2000. ``metadata["reading"]`` describes the choice in words. Coordinates are the midpoints of source
    and receiver, or the one available, or else those of the ensemble; the coordinate scalar and feet are applied.

    Args:
        path: path of the file.
        sample_interval_ns: two-way travel time between samples, if missing in the header.
        time_zero_ns: time zero, relative to sample 0 (no SEG-Y header has it in ns).
        sample_format: coding of float samples; default: that of the header, unless the samples cannot be of it, which
            ``Profile.notes`` then state.
        partial: read the intact traces of a file that ends too early; ``Profile.cut`` then gives their number.

    Raises:
        InputError: the file is missing, truncated or of another format, or no header has the sample interval.
    """
    file = Path(path)
    data = read_bytes(file)
    binary = _binary_header(file, data)
    if sample_interval_ns is not None and not (np.isfinite(sample_interval_ns) and sample_interval_ns > 0):
        raise InputError(file, "sample interval", "a number above zero", f"{sample_interval_ns:g}")
    if not np.isfinite(time_zero_ns):
        raise InputError(file, "time zero", "a number", f"{time_zero_ns:g}")
    samples, words, cut = _traces(file, data, binary, partial=partial)
    traces, notes = _decoded(file, samples, binary, sample_format)
    interval_ns, interval_from = _interval(file, binary, words[117], sample_interval_ns)
    coordinates, coordinates_from = _coordinates(words, feet=binary.feet)
    positions_m = None if coordinates is None else path_lengths_m(coordinates.kind, coordinates.x, coordinates.y)
    spacing_m = None
    if positions_m is not None and len(positions_m) > 1:
        steps = np.diff(positions_m)
        mean_m = float(steps.mean())
        if mean_m > 0 and np.all(np.abs(steps - mean_m) < _EVEN * mean_m):
            spacing_m = mean_m
    return Profile(
        path=file,
        channels=traces[:, None, :],
        sample_interval_ns=interval_ns,
        time_zero_ns=time_zero_ns,
        spacing_m=spacing_m,
        centre_frequency_hz=None,
        positions_m=positions_m,
        metadata={
            "revision": f"{binary.revision[0]}.{binary.revision[1]}",
            "format": binary.format,
            "reading": f"sample interval {interval_ns:g} ns from {interval_from}; coordinates from {coordinates_from}",
            "coordinates": coordinates_from,
        },
        coordinates=coordinates,
        cut=cut,
        notes=notes,
    )


class _Binary(NamedTuple):
    """Words of the binary header, and the layout that they state.

    Attributes:
        order: byte order, ``>`` or ``<``, as in ``struct``.
        format: code of the sample format.
        revision: major and minor revision.
        interval, exact_us: interval word, and the extended one of revision 2; 0 if missing.
        feet: whether lengths are in feet.
        samples: number of samples per trace.
        header_bytes: size of a trace's header, with its additional headers.
        begin, end: byte range of the traces in the file.
        traces: stated number of traces; ``None``: not stated.
    """

    order: str
    format: int
    revision: tuple[int, int]
    interval: int
    exact_us: float
    feet: bool
    samples: int
    header_bytes: int
    begin: int
    end: int
    traces: int | None

    @property
    def trace_bytes(self) -> int:
        """Size of a trace with its headers."""
        return self.header_bytes + self.samples * np.dtype(_FORMATS[self.format][0]).itemsize


def _binary_header(file: Path, data: bytes) -> _Binary:
    header = data[_TEXT_BYTES : _TEXT_BYTES + _BINARY_BYTES]
    if len(header) < _BINARY_BYTES:
        raise InputError(file, "file", "SEG-Y headers of 3600 bytes", f"{len(data)} bytes")
    codes = {order: struct.unpack_from(f"{order}h", header, 24)[0] for order in (">", "<")}
    order = next((o for o, code in codes.items() if code in _FORMATS), None)
    if order is None:
        expected = "1 (IBM float), 2 (int32), 3 (int16), 5 (IEEE float) or 8 (int8)"
        raise InputError(file, "binary header, sample format", expected, str(min(codes.values(), key=abs)))

    def word(place: int, code: str) -> int:
        """The word that begins at a byte, counted from 1 as in the standard."""
        return int(struct.unpack_from(order + code, header, place - _TEXT_BYTES - 1)[0])

    revision = header[300], header[301]
    if revision not in _REVISIONS and revision[::-1] in _REVISIONS:
        revision = revision[::-1]
    second = revision[0] >= 2
    extended, additional = word(3505, "h"), word(3507, "i") if second else 0
    begin, traces, trailers = (word(3521, "Q"), word(3513, "Q"), word(3529, "i")) if second else (0, 0, 0)
    if extended < 0 and not begin:
        raise InputError(file, "binary header, extended text headers", "a number of headers", str(extended))
    if not 0 <= additional <= 1000:
        raise InputError(file, "binary header, additional trace headers", "0 to 1000", str(additional))
    whole = _TEXT_BYTES + _BINARY_BYTES
    after = whole + _TEXT_BYTES * extended
    samples = (word(3269, "I") if second else 0) or word(3221, "H")
    if not samples:  # the first trace may say so alone
        at = (begin or after) + 114
        samples = int.from_bytes(data[at : at + 2], "big" if order == ">" else "little")
    if not 2 <= samples <= len(data):
        raise InputError(file, "binary header, samples a trace", "at least 2, and no more than bytes", str(samples))
    found = _Binary(
        order=order,
        format=codes[order],
        revision=revision,
        interval=word(3217, "H"),
        exact_us=struct.unpack_from(f"{order}d", header, 72)[0] if second else 0.0,
        feet=word(3255, "h") == 2,
        samples=samples,
        header_bytes=_TRACE_HEADER_BYTES * (1 + additional),
        begin=begin or after,
        end=len(data) - _TEXT_BYTES * max(trailers, 0),
        traces=traces or None,
    )
    if begin and not whole <= begin <= len(data):
        raise InputError(file, "binary header, offset of the first trace", f"{whole} to {len(data)}", str(begin))
    # Revision 0 has no such headers: its word counts where the traces fill the rest of the file.
    if revision[0] == 0 and extended and (found.end - after) % found.trace_bytes:
        found = found._replace(begin=whole)
    # A number of trailers that is not stated: the traces end before them.
    if trailers < 0 and traces:
        found = found._replace(end=min(found.end, found.begin + traces * found.trace_bytes))
    return found


def _traces(
    file: Path, data: bytes, binary: _Binary, *, partial: bool
) -> tuple[Num[np.ndarray, "trace sample"], dict[int, Int[np.ndarray, " trace"]], str | None]:
    """Samples as stored, header words by their place, and ``Profile.cut``."""
    stored = np.dtype(f"{binary.order}{_FORMATS[binary.format][0]}")
    record = np.dtype(
        {
            "names": [*map(str, _TRACE_WORDS), "samples"],
            "formats": [*(binary.order + code for code in _TRACE_WORDS.values()), (stored, binary.samples)],
            "offsets": [*(place - 1 for place in _TRACE_WORDS), binary.header_bytes],
            "itemsize": binary.trace_bytes,
        }
    )
    size = max(binary.end - binary.begin, 0)
    records = np.frombuffer(data, record, count=size // binary.trace_bytes, offset=min(binary.begin, len(data)))
    # Where the layout is another one, samples are read as headers.
    stated = records["115"][records["115"] != 0]
    other = np.flatnonzero(stated != stated[:1])
    if other.size:
        expected = f"{stated[0]} in all of them, as in the first"
        raise InputError(file, "trace headers, samples a trace", expected, f"{stated[other[0]]}")
    said = None if binary.traces is None else (binary.traces, file)
    whole, cut = count_traces(file, size, binary.trace_bytes, said=said, partial=partial)
    words = {place: records[str(place)][:whole].astype(np.int64) for place in _TRACE_WORDS}
    return records["samples"][:whole], words, cut


def _decoded(
    file: Path, stored: Num[np.ndarray, "trace sample"], binary: _Binary, given: SampleFormat | None
) -> tuple[Num[np.ndarray, "trace sample"], tuple[str, ...]]:
    """Samples as numbers, and a note where they are not of the format that the header states."""
    stated = _FLOATS.get(binary.format)
    if stated is None:
        if given is not None:
            raise InputError(file, "sample format", "float samples, for --sample-format", "integers")
        return stored.astype(_FORMATS[binary.format][1]), ()
    words = stored.astype(np.uint32)
    ieee = words.view(np.float32)
    read = given or _coding(words, stated)
    notes: tuple[str, ...] = ()
    if given is None and read != stated:
        said, found = stated.upper(), read.upper()
        marked = f"marked {said}; read as marked by lgprjax import --sample-format {stated}"
        notes = (f"{file.name}: the samples are {found} floats, {marked}",)
    return ieee if read == "ieee" else _of_ibm(words), notes


def _of_ibm(words: UInt32[np.ndarray, "trace sample"]) -> Float[np.ndarray, "trace sample"]:
    """Values of IBM floats: sign, exponent to the base 16 with 64 added, fraction of 24 bits."""
    fraction = (words & 0xFFFFFF).astype(np.float32)
    exponent = 4 * ((words >> 24) & 0x7F).astype(np.int32) - (256 + 24)
    with np.errstate(over="ignore", under="ignore"):
        return np.where(words >> 31, -1, 1).astype(np.float32) * np.ldexp(fraction, exponent)


def _coding(words: UInt32[np.ndarray, "trace sample"], stated: SampleFormat) -> SampleFormat:
    """Coding of floats: as stated, unless their bits say otherwise.

    The first of the six hexadecimal digits of an IBM fraction is never zero. In IEEE floats these bits are the lowest
    of the exponent and the highest of the fraction, and are zero in one value of twelve.
    """
    values = words[(words & 0xFFFFFF) != 0]
    zero = np.count_nonzero((values & 0xF00000) == 0)
    if stated == "ibm":
        return "ieee" if zero > _MISREAD * len(values) else stated
    spread = len(np.unique(values)) >= _DISTINCT and np.ptp(values >> 24 & 0x7F) >= _EXPONENTS
    return "ibm" if not zero and spread else stated


def _interval(
    file: Path, binary: _Binary, trace_words: Int[np.ndarray, " trace"], given_ns: float | None
) -> tuple[float, str]:
    found = sorted({binary.interval, *np.unique(trace_words).tolist()} - {0})
    says = f"(the header says {', '.join(map(str, found)) or 'nothing'})"
    if given_ns is not None:
        return given_ns, f"the option {says}"
    if np.isfinite(binary.exact_us) and 1e-6 <= binary.exact_us <= 0.1:
        return binary.exact_us * 1e3, "the extended interval of revision 2"
    low, high = _PLAUSIBLE_PS
    if len(found) == 1 and low <= found[0] <= high:
        return found[0] / 1e3, f"the interval word {found[0]} read as picoseconds"
    expected = f"one interval word that reads as picoseconds ({low} to {high}), or --sample-interval-ns"
    raise InputError(file, "sample interval", expected, ", ".join(map(str, found)) or "none")


def _coordinates(words: dict[int, Int[np.ndarray, " trace"]], *, feet: bool) -> tuple[TraceCoordinates | None, str]:
    """Coordinates of the traces, and their source, in words."""
    scalar = words[71].astype(np.float64)
    factor = np.where(scalar < 0, 1.0 / np.where(scalar < 0, -scalar, 1.0), np.where(scalar > 0, scalar, 1.0))
    pairs = {name: np.stack([words[x], words[y]]) for name, (x, y) in _PAIRS.items()}
    there = {name: pair for name, pair in pairs.items() if np.any(pair)}
    if "source" in there and "receiver" in there:
        chosen, name = (there["source"] + there["receiver"]) / 2, "the midpoints of source and receiver"
        present = np.any(there["source"] != 0, axis=0) & np.any(there["receiver"] != 0, axis=0)
    elif there:
        name, chosen = next(iter(there.items()))
        present = np.any(chosen != 0, axis=0)
        name = f"the {name} fields"
    else:
        return None, "no header"
    x, y = chosen * factor
    unit = int(words[89][0])
    if unit not in (2, 3) and not present.all():
        return None, f"no header ({name}: {np.count_nonzero(~present)} of {present.size} traces without)"
    if np.ptp(x) == 0 and np.ptp(y) == 0:
        return None, f"no header ({name}: all traces in one place)"
    if unit == 4:
        return None, f"no header ({name}: degrees, minutes and seconds are not read)"
    if unit in (2, 3):
        to_degrees = 3600.0 if unit == 2 else 1.0
        x, y = chosen = np.stack([x, y]) / to_degrees
        kept, x, left_out = plausible_positions(y, x, None)
        first = int(np.argmin(kept))
        if 2 * np.count_nonzero(kept) < kept.size:
            far = f"longitude {chosen[0][first]:g}, latitude {chosen[1][first]:g}"
            return None, f"no header ({name}: {left_out_in_words(left_out, kept.size)}, such as {far})"
        x[kept] = np.unwrap(x[kept], period=360.0)
    elif max(np.max(np.abs(x)), np.max(np.abs(y))) > _FARTHEST_M:
        found = f"x {x.min():.6g} to {x.max():.6g}, y {y.min():.6g} to {y.max():.6g}"
        return None, f"no header ({name}: {found} are no standard coordinates)"
    else:
        x, y = (axis * (_FOOT_M if feet else 1.0) for axis in (x, y))
        # A site's own metres are distances along its lines, and a step in them is refused.
        kept = plausible_places(x, y, None) if metres_kind(x, y) == "grid metres" else np.ones(x.size, bool)
        left_out = {} if kept.all() else {ASTRAY: int(np.count_nonzero(~kept))}
    if left_out:
        name = f"{name}, {left_out_in_words(left_out, kept.size)}"
        x, y = (np.interp(np.arange(kept.size), np.flatnonzero(kept), axis[kept]) for axis in (x, y))
    if unit in (2, 3):
        return TraceCoordinates("degrees", (x + 180.0) % 360.0 - 180.0, y), f"{name}, degrees"
    return TraceCoordinates("metres", x, y), f"{name}, length"


_PAIRS = {"source": (73, 77), "receiver": (81, 85), "ensemble": (181, 185)}


# A SEG-Y line as a drive log: on its own coordinates if they have a place on the earth, else straight.


def import_segy(
    path: str | Path,
    *,
    sample_interval_ns: float | None = None,
    time_zero_ns: float = 0.0,
    sample_format: SampleFormat | None = None,
    utm_zone: str | None = None,
    place: SurveyOrigin,
    length_m: float | None = None,
    partial: bool = False,
    output: str | Path,
    force: bool = False,
) -> tuple[str, ...]:
    """Write one SEG-Y line as a drive log of one channel.

    Coordinates in degrees, or in metres of a given UTM zone, place every trace: traces stay as recorded and
    the heading follows their path. Otherwise the line leaves ``place`` straight along its heading, at the distances
    of its coordinates or evenly over ``length_m``.

    Args:
        path: path of the file.
        sample_interval_ns, time_zero_ns, sample_format, partial: see ``read_segy``.
        utm_zone: zone of coordinates in metres, such as ``19N``.
        place: origin and direction of a line without geographic positions.
        length_m: length of the line, measured by tape; coordinates are then unused.
        output: path of the drive log.
        force: whether to replace an existing output.

    Returns:
        Notes on unused input, contradictions in the file, and the part read of a truncated file.

    Raises:
        InputError: the file cannot be read or has no sample interval, or the line has no length.
    """
    if utm_zone is not None:
        utm_projection(utm_zone)  # a wrong zone is refused where nothing needs one, too
    profile = read_segy(
        path,
        sample_interval_ns=sample_interval_ns,
        time_zero_ns=time_zero_ns,
        sample_format=sample_format,
        partial=partial,
    )
    provenance: dict[str, object] = {
        "made_by": "lgprjax import segy",
        "inputs": inputs_of([path]),
        "revision": profile.metadata["revision"],
        "reading": profile.metadata["reading"],
        "utm_zone": utm_zone,
    }
    at_first = time_zero_assumed(time_zero_ns, profile.channels.shape[2] * profile.sample_interval_ns)
    where = None if length_m is not None else _on_the_earth(profile, utm_zone)
    kind = None if profile.coordinates is None else profile.coordinates.kind
    notes = [*profile.notes, *([] if profile.cut is None else [f"{profile.path.name}: read {profile.cut}"])]
    if "left out" in (source := str(profile.metadata["coordinates"])):
        notes.append(f"coordinates from {source}")
    if utm_zone is not None and (length_m is not None or kind == "degrees"):
        why = "the line is placed by its length" if length_m is not None else "the coordinates are in degrees"
        notes.append(unused_zone(utm_zone, why))
    if where is not None:
        latitude_deg, longitude_deg = where
        try:
            travelled = travel_along_path(latitude_deg, longitude_deg)
        except ValueError:
            raise InputError(profile.path, "coordinates", "positions along a line", "one position") from None
        write_positioned_lines(
            [profile],
            latitude_deg=[latitude_deg],
            longitude_deg=[longitude_deg],
            travel_m=[travelled.distance_m],
            output=output,
            provenance=provenance,
            assumed={"odometry": travelled.in_words(), **at_first},
            force=force,
        )
        return (*notes, *([] if place.assumed() else [UNUSED_PLACE]))
    write_lines(
        [profile],
        place=place,
        output=output,
        provenance=provenance,
        assumed={**place.assumed(), **at_first},
        length_m=length_m,
        force=force,
    )
    return tuple(notes)


def _on_the_earth(
    profile: Profile, utm_zone: str | None
) -> tuple[Float[np.ndarray, " trace"], Float[np.ndarray, " trace"]] | None:
    """Latitude and longitude of the traces, if their coordinates and the options give them."""
    coordinates = profile.coordinates
    if coordinates is None:
        if utm_zone is not None:
            found = str(profile.metadata["coordinates"])
            raise InputError(profile.path, "coordinates", "eastings and northings, or --length-m", found)
        return None
    if coordinates.kind == "degrees":
        return coordinates.y, coordinates.x
    x, y = coordinates.x, coordinates.y
    if utm_zone is None:
        # Metres of a survey's own begin near 0; those of a grid are a place, which is not dropped unsaid.
        if metres_kind(x, y) == "grid metres":
            found = f"x {x.min():.6g} to {x.max():.6g} m, y {y.min():.6g} to {y.max():.6g} m"
            raise InputError(profile.path, "coordinates", "--utm-zone, or --length-m to leave them unused", found)
        return None
    check_utm(profile.path, "coordinates", x, y)
    longitude_deg, latitude_deg = utm_projection(utm_zone)(x, y, inverse=True)
    return np.asarray(latitude_deg), np.asarray(longitude_deg)
