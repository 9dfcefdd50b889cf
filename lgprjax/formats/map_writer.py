"""Writing, copying and locking maps: station by station, complete or not at all."""

import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import IO

import h5py
import numpy as np
from jaxtyping import Float, Integer

from lgprjax.errors import InputError
from lgprjax.files import lock_file
from lgprjax.formats.map_file import MapFile
from lgprjax.formats.map_layout import (
    BLOCK,
    STANDARD,
    UNIT,
    CodedTraces,
    MapPrecision,
    StoredStations,
    TraceCode,
    differences,
    encode,
    moved,
    places_of_rows,
    stored_block,
    trace_code,
    write_chance,
)
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import GuardedFile, create_array, create_store, validate_store, write_array, write_attribute
from lgprjax.registration import Chance, ladder_of
from lgprjax.subsurface import MapDescription, StationBlock, StationRuns, stretches_of

_SCHEMA = load_schema("map")


class MapWriter:
    """A subsurface database being written; a context manager. It gets its name when it is complete.

    Codes need the depth gain, which is known after all baselines: until then traces are kept in an unnamed file next to
    the output.

    Attributes:
        stations: number of stations appended so far.
        precision: precision of the traces.
    """

    def __init__(
        self, path: Path, store: h5py.File, output: GuardedFile, cleanup: ExitStack, precision: MapPrecision
    ) -> None:
        self.path = path
        self.stations = 0
        self.precision = precision
        self._store = store
        self._output = output
        self._cleanup = cleanup
        self._code: TraceCode | None = None
        self._waiting: IO[bytes] | None = None
        self._products: np.ndarray | None = None
        self._traces = 0
        self._last: dict[str, np.ndarray] = {}
        self._stretches: list[StationRuns] = []

    @classmethod
    def create(cls, path: str | Path, *, precision: MapPrecision = STANDARD, force: bool = False) -> "MapWriter":
        """Begin a database. Raises ``InputError`` if the output cannot be written or exists."""
        with ExitStack() as cleanup:
            store, output = cleanup.enter_context(create_store(path, _SCHEMA, force))
            return cls(Path(path), store, output, cleanup.pop_all(), precision)
        raise AssertionError("unreachable: the stack passes exceptions on")

    def __enter__(self) -> "MapWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._waiting is not None:
            # A full disk was reported when the traces were written: closing must not replace that error.
            with suppress(OSError):
                self._waiting.close()
        if error is not None:
            self._cleanup.__exit__(kind, error, trace)
            return
        with self._cleanup:
            for finding in validate_store(self._store, self.path, _SCHEMA):
                if finding.severity == "error":
                    raise finding.error()

    @property
    def code(self) -> TraceCode | None:
        """Definition of the codes; None while unknown, and if traces are samples."""
        return self._code

    def use(self, precision: MapPrecision, code: TraceCode | None) -> None:
        """Store all traces like another map; to be called before the first station."""
        assert self.stations == 0
        self.precision, self._code = precision, code

    def append(self, block: StationBlock, drive: int) -> None:
        """Append the next stations of a drive. All drives must have the same channels."""
        stored = stored_block(block, drive)
        if self._code is not None:
            stored = stored._replace(traces=encode(self._code, block.profile, block.valid))
        self.append_stored(stored)

    def append_stored(self, stored: StoredStations) -> None:
        """Append stations in the numbers of the file."""
        if not len(stored.place):
            return
        for name, rows in (("place", stored.place), ("antenna", stored.antenna)):
            self._extend(name, differences(rows, self._last.get(name), self.stations))
            self._last[name] = rows[-1]
        self._extend("valid", stored.valid)
        if isinstance(stored.traces, CodedTraces):
            self._extend("scale", stored.traces.scale)
            self._extend_codes(stored.traces.codes)
        elif self.precision.step_rms is None:
            self._extend("traces", stored.traces, BLOCK)
        else:
            self._wait(stored)
        places = places_of_rows(stored.place)
        self._stretches.append(stretches_of(places.pose[:, :2], places.drive, self.stations))
        self.stations += len(stored.place)
        self._output.check()

    def finish(
        self,
        description: MapDescription,
        tile_frame: Float[np.ndarray, "tile 3"],
        height_reference_m: Float[np.ndarray, " tile"],
        provenance: dict[str, object],
        retired: Integer[np.ndarray, " scan"] | None = None,
    ) -> None:
        """Write the parts known only at the end: gain, tiles, the description of the map, and with the gain the codes.

        Args:
            description: description of the map.
            tile_frame: east_m, north_m, yaw_rad of every tile.
            height_reference_m: antenna height above the ground to which each tile is reduced.
            provenance: steps and inputs of the map.
            retired: number of the update that retired each station, 0 while it is in use; ``None``: all are in use.
        """
        if self._waiting is not None:
            self._encode_waiting(description)
        store, frame = self._store, description.frame
        attributes: dict[str, str | float] = {
            "name": description.name,
            "provenance": json.dumps(provenance),
            "chain": json.dumps(description.settings.as_provenance()),
            "anchor_latitude_deg": frame.latitude_deg,
            "anchor_longitude_deg": frame.longitude_deg,
            "anchor_height_m": frame.height_m,
            "sample_interval_ns": description.settings.sample_interval_ns,
            "channel_pitch_m": description.channel_pitch_m,
            "tile_spacing_m": description.tile_spacing_m,
            "precision": self.precision.name,
        }
        for name, value in attributes.items():
            write_attribute(store, name, value)
        write_array(store, _SCHEMA, "/gain", description.gain)
        write_array(store, _SCHEMA, "/tiles/frame", tile_frame)
        write_array(store, _SCHEMA, "/tiles/height_reference_m", height_reference_m)
        first, chord_m, reach_m = (np.concatenate(part) for part in zip(*self._stretches, strict=True))
        write_array(store, _SCHEMA, "/stretches/first", first)
        write_array(store, _SCHEMA, "/stretches/chord", chord_m)
        write_array(store, _SCHEMA, "/stretches/reach_m", reach_m)
        if description.weight:
            write_array(store, _SCHEMA, "/drives/weight", np.asarray(description.weight))
        if retired is not None:
            create_array(store, _SCHEMA, "/baselines/retired", (), rows=UNIT, checksum=True)
            assert int(retired.max(initial=0)) <= np.iinfo(np.uint16).max
            self._fill("retired", retired, 0)
        if self._code is not None:
            if not np.array_equal(self._code.gain, description.gain.astype(np.float32)):
                raise InputError(self.path, "/gain", "the gain used to encode the stations", "another gain")
            write_array(store, _SCHEMA, "/code/basis", self._code.basis)
            write_array(store, _SCHEMA, "/code/level", self._code.level)
            write_attribute(store["code"], "step_rms", self._code.step_rms)
        self._output.check()

    def add_chance(self, measure: Callable[[MapFile], Chance]) -> None:
        """Measure and store the chance on the finished map, before it gets its name: after ``finish``.

        Args:
            measure: called with the map open for reading; must not close it.
        """
        self._store.flush()
        self._output.check()
        written = MapFile(self.path, self._store)
        windows_m = ladder_of(written.description.settings.wavelength_m)
        write_chance(self._store, measure(written), windows_m)
        self._output.check()

    def _extend(self, name: str, rows: np.ndarray, chunk: int = UNIT) -> None:
        path = f"/baselines/{name}"
        if path not in self._store:
            create_array(self._store, _SCHEMA, path, rows.shape[1:], rows=chunk, checksum=True)
        self._fill(name, rows, self.stations)

    def _fill(self, name: str, rows: np.ndarray, start: int) -> None:
        dataset = self._store[f"/baselines/{name}"]
        dataset.resize(start + len(rows), axis=0)
        dataset[start:] = rows

    def _extend_codes(self, codes: np.ndarray) -> None:
        path, start = "/baselines/codes", self.stations
        if path not in self._store:
            create_array(self._store, _SCHEMA, path, (*codes.shape[1:], BLOCK), rows=1, checksum=True)
        dataset = self._store[path]
        stop = start + len(codes)
        dataset.resize(-(-stop // BLOCK), axis=0)
        for block in range(start // BLOCK, -(-stop // BLOCK)):
            low, high = max(start, block * BLOCK), min(stop, (block + 1) * BLOCK)
            inside = slice(low - block * BLOCK, high - block * BLOCK)
            dataset[block, :, :, inside] = np.moveaxis(codes[low - start : high - start], 0, -1)

    def _wait(self, stored: StoredStations) -> None:
        """Keep traces until the gain is known, and sums for the code."""
        assert not isinstance(stored.traces, CodedTraces)
        if self._waiting is None:
            self._waiting = tempfile.TemporaryFile(dir=self.path.parent)  # noqa: SIM115 (closed with the writer)
            self._products = np.zeros((stored.traces.shape[2],) * 2)
        assert self._products is not None
        self._waiting.write(stored.traces.tobytes())
        sample = stored.traces[stored.valid].astype(np.float64)
        self._products += sample.T @ sample
        self._traces += len(sample)

    def _encode_waiting(self, description: MapDescription) -> None:
        assert self._waiting is not None
        assert self._products is not None
        assert self.precision.step_rms is not None
        total, samples = self.stations, len(description.gain)
        self._code = trace_code(self._products, self._traces, description.gain, self.precision.step_rms)
        self._waiting.seek(0)
        valid = self._store["/baselines/valid"]
        self.stations = 0
        while self.stations < total:
            rows = valid[self.stations : self.stations + UNIT].astype(bool)
            read = self._waiting.read(2 * rows.size * samples)
            profile = np.frombuffer(read, np.float16).reshape(*rows.shape, samples).astype(np.float32)
            coded = encode(self._code, profile, rows)
            self._extend("scale", coded.scale)
            self._extend_codes(coded.codes)
            self.stations += len(rows)
            self._output.check()


# Stations are copied from map to map as stored, without rounding traces again.


def copy_stations(source: MapFile, writer: MapWriter, pose: Float[np.ndarray, "scan 5"] | None = None) -> None:
    """Append all stations of a map to one being written, without loss.

    The writer adopts the source's precision: as its first stations, or after stations stored alike. Later stations are
    stored in the same way. Of a map of version 1.0 poses are rounded to 0.1 mm and 10 microradians, antennas to 0.5 mm,
    times to 0.1 ms. Weights and retired stations are given to ``finish``.

    Args:
        source: map to copy.
        writer: writer of the new map.
        pose: pose of every station, in place of the source's; antennas turn and tilt with it.

    Raises:
        InputError: a part of the source is damaged, or the writer's stations are stored differently.
    """
    if writer.stations == 0:
        writer.use(source.precision, source.code)
    elif not _alike(source, writer):
        raise InputError(
            source.path,
            "/code/basis",
            "traces with the precision and basis of earlier stations",
            "another precision or basis",
        )
    for start in range(0, len(source.places), UNIT):
        stations = np.arange(start, min(start + UNIT, len(source.places)))
        stored = source.read_stored(stations)
        if pose is not None:
            stored = stored._replace(place=moved(stored.place, pose[stations]))
        writer.append_stored(stored)


def _alike(source: MapFile, writer: MapWriter) -> bool:
    if source.code is None or writer.code is None:
        return source.code is None and writer.code is None and writer.precision.step_rms is None
    return np.array_equal(source.code.basis, writer.code.basis) and np.array_equal(source.code.gain, writer.code.gain)


# One writer of a map at a time, and removal of remains of killed writers.


@contextmanager
def locked_map(path: str | Path) -> Iterator[None]:
    """Lock a map against other writers while the body runs; readers are not affected.

    The lock is a file next to the map, ``.NAME.lock``, which the kernel releases when its process ends. Remains of
    killed writers next to the map are removed.

    Args:
        path: the map, which need not exist yet.

    Raises:
        InputError: another process writes the map (the message names it), or the map's folder is not writable.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise InputError(target, "output", "a folder that exists", f"no folder {target.parent}")
    with ExitStack() as held:
        try:
            holder = held.enter_context(lock_file(target.with_name(f".{target.name}.lock")))
        except OSError as error:
            raise InputError(target, "output", "a file that can be locked", os.strerror(error.errno or 0)) from None
        if holder is not None:
            raise InputError(target, "output", "a map that no other process is writing", f"in use by {holder}")
        _clear_remains(target)
        yield


def scratch_folder(path: str | Path) -> Path:
    """Folder for a map's unfinished parts in this process: next to the map, so that a rename completes it.

    If the process is killed, its contents are removed with the next lock on the map.
    """
    target = Path(path)
    return target.with_name(f".{target.name}.partial-{os.getpid()}-parts")


def _clear_remains(target: Path) -> None:
    """Remove unfinished outputs of processes that have ended."""
    remains = re.compile(rf"\.{re.escape(target.name)}\.partial-(\d{{1,9}})(?:-parts)?")
    for entry in target.parent.iterdir():
        left = remains.fullmatch(entry.name)
        if left is None or _alive(int(left.group(1))):
            continue
        if entry.is_dir():
            shutil.rmtree(entry, ignore_errors=True)
        else:
            with suppress(OSError):
                entry.unlink()


def _alive(process: int) -> bool:
    if sys.platform == "win32":  # there a signal would end the process
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
