"""SEG-Y lines written by radars. Needs the optional package segyio (``pip install lgprjax[segy]``)."""

import struct
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
from jaxtyping import Float, Int, Num

from lgprjax.errors import InputError
from lgprjax.formats.line_layout import inputs_of, write_lines, write_positioned_lines
from lgprjax.formats.plausible import ASTRAY, left_out_in_words, plausible_places, plausible_positions
from lgprjax.formats.profile import Profile, TraceCoordinates, count_traces, read_bytes
from lgprjax.formats.side_positions import metres_kind
from lgprjax.formats.survey_track import (
    UNUSED_PLACE,
    SurveyOrigin,
    check_utm,
    time_zero_assumed,
    travel_along_path,
    unused_zone,
    utm_projection,
)

_TEXT_BYTES, _BINARY_BYTES, _TRACE_HEADER_BYTES = 3200, 400, 240
# Bytes a sample and the type returned, by the format code: IBM float, int32, int16, IEEE float, int8.
_FORMATS: dict[int, tuple[int, type[np.generic]]] = {
    1: (4, np.float32),
    2: (4, np.int32),
    3: (2, np.int16),
    5: (4, np.float32),
    8: (1, np.int16),
}
# A header word of microseconds cannot hold a radar's interval; radars' programs write picoseconds in it. Only words in
# this range are read as such: 0.01 ns (100 GHz) to 2 ns (Nyquist 250 MHz). Seismic defaults (4000) are outside.
_PLAUSIBLE_PS = (10, 2000)
_FOOT_M = 0.3048
# Steps that vary by less than this share are even.
_EVEN = 0.02


def read_segy(
    path: str | Path, *, sample_interval_ns: float | None = None, time_zero_ns: float = 0.0, partial: bool = False
) -> Profile:
    """Read one SEG-Y file of revision 0, 1 or 2, big- or little-endian; IBM or IEEE float, int32, int16 or int8.

    The sample interval is, in this order: ``sample_interval_ns`` if given; the extended interval of revision 2; the
    interval word of the binary and trace headers, read as picoseconds, if they agree and it is from 10 to 2000.
    ``metadata["reading"]`` describes the choice in words. Coordinates are the midpoints of source and receiver, or the
    one available, or else those of the ensemble; the coordinate scalar and feet are applied.

    Args:
        path: the file.
        sample_interval_ns: two-way travel time between samples, if missing in the header.
        time_zero_ns: time zero, relative to sample 0 (no SEG-Y header has it in ns).
        partial: read the intact traces of a file that ends too early; ``Profile.cut`` then gives their number.

    Raises:
        InputError: segyio is missing, the file is missing, truncated or of another format, or no header has the sample
            interval.
    """
    file = Path(path)
    data = read_bytes(file)
    order, binary, whole_bytes, cut = _binary_header(file, data, partial=partial)
    if sample_interval_ns is not None and not (np.isfinite(sample_interval_ns) and sample_interval_ns > 0):
        raise InputError(file, "sample interval", "a number above zero", f"{sample_interval_ns:g}")
    if not np.isfinite(time_zero_ns):
        raise InputError(file, "time zero", "a number", f"{time_zero_ns:g}")
    segyio = _segyio(file)
    if cut is None:
        stored, words = _traces(segyio, file, file, order)
    else:
        # The library opens only files of complete traces.
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder) / file.name
            whole.write_bytes(memoryview(data)[:whole_bytes])
            stored, words = _traces(segyio, file, whole, order)
    interval_ns, interval_from = _interval(file, binary, words[117], sample_interval_ns)
    coordinates, coordinates_from = _coordinates(words, feet=binary["units"] == 2)
    positions_m = None if coordinates is None else _along_m(coordinates)
    spacing_m = None
    if positions_m is not None and len(positions_m) > 1:
        steps = np.diff(positions_m)
        mean_m = float(steps.mean())
        if mean_m > 0 and np.all(np.abs(steps - mean_m) < _EVEN * mean_m):
            spacing_m = mean_m
    traces = stored.astype(_FORMATS[binary["format"]][1])
    return Profile(
        path=file,
        channels=traces[:, None, :],
        sample_interval_ns=interval_ns,
        time_zero_ns=time_zero_ns,
        spacing_m=spacing_m,
        centre_frequency_hz=None,
        positions_m=positions_m,
        metadata={
            "revision": binary["revision"],
            "format": binary["format"],
            "reading": f"sample interval {interval_ns:g} ns from {interval_from}; coordinates from {coordinates_from}",
            "coordinates": coordinates_from,
        },
        coordinates=coordinates,
        cut=cut,
    )


# First bytes, counted from 1 as in the standard, of the words read from every trace header.
_TRACE_WORDS = (71, 73, 77, 81, 85, 89, 117, 181, 185)


def _segyio(file: Path) -> Any:
    try:
        import segyio
    except ImportError:
        expected = "the optional package segyio (pip install lgprjax[segy])"
        raise InputError(file, "SEG-Y", expected, "none") from None
    return segyio


def _traces(
    segyio: Any, file: Path, whole: Path, order: str
) -> tuple[Num[np.ndarray, "trace sample"], dict[int, Int[np.ndarray, " trace"]]]:
    """Samples, and header words by their place, of a file of complete traces; errors name ``file``."""
    try:
        with segyio.open(str(whole), ignore_geometry=True, endian="big" if order == ">" else "little") as store:
            stored = np.atleast_2d(store.trace.raw[:])
            words = {place: np.asarray(store.attributes(place)[:], dtype=np.int64) for place in _TRACE_WORDS}
    except (OSError, RuntimeError, ValueError, IndexError) as error:
        raise InputError(file, "file", "a complete SEG-Y file", str(error) or type(error).__name__) from None
    return stored, words


def _binary_header(file: Path, data: bytes, *, partial: bool) -> tuple[str, dict[str, Any], int, str | None]:
    """Byte order, relevant words of the binary header, the bytes up to the last complete trace, and what is cut."""
    header = data[_TEXT_BYTES : _TEXT_BYTES + _BINARY_BYTES]
    if len(header) < _BINARY_BYTES:
        raise InputError(file, "file", "SEG-Y headers of 3600 bytes", f"{len(data)} bytes")
    codes = {order: struct.unpack_from(f"{order}h", header, 24)[0] for order in (">", "<")}
    order = next((o for o, code in codes.items() if code in _FORMATS), None)
    if order is None:
        expected = "1 (IBM float), 2 (int32), 3 (int16), 5 (IEEE float) or 8 (int8)"
        raise InputError(file, "binary header, sample format", expected, str(codes[">"]))
    interval, samples = (struct.unpack_from(f"{order}H", header, at)[0] for at in (16, 20))
    units, extended_headers = (struct.unpack_from(f"{order}h", header, at)[0] for at in (54, 304))
    major, minor = header[300], header[301]
    exact_us = struct.unpack_from(f"{order}d", header, 72)[0] if major >= 2 else 0.0
    if major >= 2 and samples == 0:
        samples = struct.unpack_from(f"{order}I", header, 68)[0]
    if samples < 2:
        raise InputError(file, "binary header, samples a trace", "at least 2", str(samples))
    if extended_headers < 0:
        raise InputError(file, "binary header, extended text headers", "a number of headers", str(extended_headers))
    before = _TEXT_BYTES + _BINARY_BYTES + _TEXT_BYTES * (extended_headers if major >= 1 else 0)
    trace_bytes = _TRACE_HEADER_BYTES + samples * _FORMATS[codes[order]][0]
    whole, cut = count_traces(file, len(data) - before, trace_bytes, said=None, partial=partial)
    words = {
        "format": codes[order],
        "interval": interval,
        "exact_us": exact_us,
        "units": units,
        "revision": f"{major}.{minor}",
    }
    return order, words, before + whole * trace_bytes, cut


def _interval(
    file: Path, binary: dict[str, Any], trace_words: Int[np.ndarray, " trace"], given_ns: float | None
) -> tuple[float, str]:
    found = sorted({binary["interval"], *np.unique(trace_words & 0xFFFF).tolist()} - {0})
    says = f"(the header says {', '.join(map(str, found)) or 'nothing'})"
    if given_ns is not None:
        return given_ns, f"the option {says}"
    if np.isfinite(binary["exact_us"]) and 1e-6 <= binary["exact_us"] <= 0.1:
        return binary["exact_us"] * 1e3, "the extended interval of revision 2"
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


def _along_m(coordinates: TraceCoordinates) -> Float[np.ndarray, " trace"]:
    """Cumulative distance along the traces."""
    if coordinates.kind == "degrees":
        x, y = coordinates.x, coordinates.y
        steps = pyproj.Geod(ellps="WGS84").inv(x[:-1], y[:-1], x[1:], y[1:])[2]
    else:
        steps = np.hypot(np.diff(coordinates.x), np.diff(coordinates.y))
    return np.concatenate([[0.0], np.cumsum(steps)])


# A SEG-Y line as a drive log: on its own coordinates if they have a place on the earth, else straight.


def import_segy(
    path: str | Path,
    *,
    sample_interval_ns: float | None = None,
    time_zero_ns: float = 0.0,
    utm_zone: str | None = None,
    place: SurveyOrigin,
    length_m: float | None = None,
    output: str | Path,
    force: bool = False,
) -> tuple[str, ...]:
    """Write one SEG-Y line as a drive log of one channel.

    Coordinates in degrees, or in metres of a given UTM zone, place every trace: traces stay as recorded and
    the heading follows their path. Otherwise the line leaves ``place`` straight along its heading, at the distances
    of its coordinates or evenly over ``length_m``.

    Args:
        path: the file.
        sample_interval_ns, time_zero_ns: see ``read_segy``.
        utm_zone: zone of coordinates in metres, such as ``19N``.
        place: origin and direction of a line that has no place on the earth.
        length_m: length of the line, measured by tape; coordinates are then unused.
        output: the drive log.
        force: replace an output that exists.

    Returns:
        What was given and not used, and why, in words.

    Raises:
        InputError: the file cannot be read or has no sample interval, or the line has no length.
    """
    if utm_zone is not None:
        utm_projection(utm_zone)  # a wrong zone is refused where nothing needs one, too
    profile = read_segy(path, sample_interval_ns=sample_interval_ns, time_zero_ns=time_zero_ns)
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
    notes = [f"coordinates from {source}"] if "left out" in (source := str(profile.metadata["coordinates"])) else []
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
            height_m=None,
            travel_m=[travelled.distance_m],
            output=output,
            provenance=provenance,
            assumed={"odometry": travelled.in_words(), **at_first},
            force=force,
        )
        return (*notes, *([] if place.assumed() else [UNUSED_PLACE]))
    write_lines(
        [profile],
        left_m=np.zeros(1),
        forward_m=np.zeros(1),
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
            raise InputError(profile.path, "coordinates", "eastings and northings", str(profile.metadata["reading"]))
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
