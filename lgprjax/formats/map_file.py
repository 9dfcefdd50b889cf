"""The subsurface database on disk, read on demand."""

import json
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

import h5py
import numpy as np
from jaxtyping import Float, Float16, Int, Integer

from lgprjax.errors import InputError
from lgprjax.formats.map_layout import (
    BLOCK,
    FULL,
    CodedTraces,
    MapPrecision,
    StoredStations,
    SummedRows,
    TraceCode,
    antenna_codes,
    antennas_of_codes,
    decode,
    place_rows,
    places_of_rows,
    read_chance,
    read_rows,
)
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import attribute_of, open_store, reading, validate_store
from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings
from lgprjax.registration import Chance, ladder_of
from lgprjax.subsurface import MapDescription, StationPlaces, StationPositions, StationRuns, Stations

# Traces of a subsurface database, read for the requested stations: as samples, or as codes.


class SampledTraces:
    """Traces as 16-bit samples.

    Attributes:
        code: none.
    """

    code: TraceCode | None = None

    def __init__(self, store: h5py.File, path: Path) -> None:
        self._traces, self._path = store["baselines/traces"], path

    def stored(self, stations: Int[np.ndarray, " scan"]) -> Float16[np.ndarray, "scan channel sample"]:
        """As stored in the file."""
        return read_rows(self._traces, self._path, stations)

    def profile(self, stations: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel sample"]:
        """Before the depth gain."""
        return self.stored(stations).astype(np.float32)


class CodedTraceBlocks:
    """Traces as codes, in blocks of 256 stations.

    Attributes:
        code: their definition.
    """

    def __init__(self, store: h5py.File, path: Path) -> None:
        self._codes, self._scale, self._path = store["baselines/codes"], store["baselines/scale"], path
        step_rms = attribute_of(store["code"], "step_rms")
        assert isinstance(step_rms, int | float)
        self.code = TraceCode(float(step_rms), store["gain"][()], store["code/basis"][()], store["code/level"][()])
        blocks, due = len(self._codes), -(-len(self._scale) // BLOCK)
        if blocks != due:
            raise InputError(path, "/baselines/codes", f"{due} blocks of {BLOCK} stations", str(blocks))
        if not _orthonormal(self.code.basis):
            raise InputError(path, "/code/basis", "as many orthonormal components as samples", "other components")

    def stored(self, stations: Int[np.ndarray, " scan"]) -> CodedTraces:
        """As stored in the file."""
        codes = np.zeros((len(stations), *self._codes.shape[1:3]), np.int8)
        for block in np.unique(stations // BLOCK):
            own = stations // BLOCK == block
            with reading(self._path, f"/baselines/codes, stations {block * BLOCK} to {(block + 1) * BLOCK - 1}"):
                codes[own] = np.moveaxis(self._codes[int(block)], -1, 0)[stations[own] - block * BLOCK]
        return CodedTraces(codes, read_rows(self._scale, self._path, stations))

    def profile(self, stations: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel sample"]:
        """Before the depth gain."""
        return decode(self.code, self.stored(stations))


def _orthonormal(basis: Float[np.ndarray, "component sample"]) -> bool:
    components, samples = basis.shape
    return components == samples and np.allclose(basis @ basis.T, np.eye(samples), atol=1e-3)


_SCHEMA = load_schema("map")
_PLACE_UNITS_HELD = 64
_ANTENNA_UNITS_HELD = 8


class MapFile:
    """A subsurface database, open for reading; a context manager and a ``StationSource``.

    The stretches of the tracks and the tiles' frames are held in memory, about 100 bytes per metre of baseline;
    everything else is read when a tile needs it. Damaged data raise ``InputError`` when read, naming dataset and
    stations. Files of version 1.0 have their poses in memory, 60 bytes per station.

    Attributes:
        path: path of the file.
        description: description of the whole map.
        provenance: steps and inputs of the map.
        precision: precision of the traces.
        places: positions of the stations.
        tile_frame: east_m, north_m, yaw_rad of every tile.
        height_reference_m: antenna height above the ground to which each tile is reduced.
        chance: false-match statistics of the map; ``None`` if the file has none.
    """

    def __init__(self, path: Path, store: h5py.File) -> None:
        self.path = path
        self._store = store
        self.provenance: dict[str, object] = json.loads(str(attribute_of(store, "provenance")))
        self.precision = self._precision()
        coded = "codes" in store["baselines"]
        self._traces: CodedTraceBlocks | SampledTraces = (
            CodedTraceBlocks(store, path) if coded else SampledTraces(store, path)
        )
        self._place: SummedRows | None = None
        self._antenna: SummedRows | None = None
        if "place" in store["baselines"]:
            self._place = SummedRows(store["baselines/place"], path, _PLACE_UNITS_HELD)
            self._antenna = SummedRows(store["baselines/antenna"], path, _ANTENNA_UNITS_HELD)
            self.places = StationPlaces(self._stretches(), len(store["baselines/place"]), self._read_places)
        else:
            held = (store[f"baselines/{name}"][()] for name in ("pose", "ground_up_m", "drive"))
            self.places = StationPlaces.held(StationPositions(*held))
        self.description = self._description()
        self.tile_frame: Float[np.ndarray, "tile 3"] = store["tiles/frame"][()]
        self.height_reference_m: Float[np.ndarray, " tile"] = store["tiles/height_reference_m"][()]
        self.chance: Chance | None = read_chance(store, path, ladder_of(self.description.settings.wavelength_m))

    @classmethod
    def open(cls, path: str | Path) -> "MapFile":
        """Open a database. Raises ``InputError`` for the first mismatch with the schema."""
        file = Path(path)
        store = open_store(file)
        try:
            for finding in validate_store(store, file, _SCHEMA):
                if finding.severity == "error":
                    raise finding.error()
            with reading(file, "/baselines"):
                return cls(file, store)
        except BaseException:
            store.close()
            raise

    def __enter__(self) -> "MapFile":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._store.close()

    @property
    def code(self) -> TraceCode | None:
        """Definition of the traces' codes; None if traces are samples."""
        return self._traces.code

    @property
    def level(self) -> Float[np.ndarray, " sample"] | None:
        """RMS of the traces at each depth before they were coded; None where they are samples."""
        return None if self.code is None else self.code.level

    @cached_property
    def _all(self) -> StationPositions:
        return self.places.read(np.arange(len(self.places)))

    @property
    def pose(self) -> Float[np.ndarray, "scan 5"]:
        """Pose of every station, read whole and cached."""
        return self._all.pose

    @property
    def ground_up_m(self) -> Float[np.ndarray, " scan"]:
        """Height of the ground under every station, read whole and cached."""
        return self._all.ground_up_m

    @property
    def drive(self) -> Int[np.ndarray, " scan"]:
        """Baseline of every station, read whole and cached."""
        return self._all.drive

    @property
    def retired(self) -> Integer[np.ndarray, " scan"]:
        """Number of the update that retired each station; 0 while it is in use."""
        return self._retired(np.arange(len(self.places)))

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these rising numbers; those out of use are not valid.

        Raises:
            InputError: a part of them is damaged.
        """
        in_use = self._retired(stations) == 0
        return Stations(
            profile=self._traces.profile(stations),
            valid=self._valid(stations) & in_use[:, None],
            antenna_m=self._antennas(stations),
        )

    def read_stored(self, stations: Int[np.ndarray, " scan"]) -> StoredStations:
        """Stations with these rising numbers in the numbers of the file. Raises ``InputError`` as ``read_stations``."""
        if self._place is not None and self._antenna is not None:
            place, antenna = self._place.read(stations), self._antenna.read(stations)
        else:
            where = self.places.read(stations)
            time_s = read_rows(self._store["baselines/time_s"], self.path, stations)
            place = place_rows(where.pose, where.ground_up_m, where.drive, time_s)
            antenna = antenna_codes(self._antennas(stations), where.pose)
        return StoredStations(place, antenna, self._valid(stations), self._traces.stored(stations))

    def stored_bytes(self) -> dict[str, int]:
        """Bytes of the parts of the file: traces, places, antennas, and the rest."""
        parts = {
            "traces": ("traces", "codes", "scale"),
            "places": ("place", "pose", "ground_up_m", "drive", "time_s"),
            "antennas": ("antenna", "antenna_m", "valid"),
        }
        held = self._store["baselines"]
        sizes = {
            part: sum(int(held[name].id.get_storage_size()) for name in names if name in held)
            for part, names in parts.items()
        }
        return {**sizes, "rest": self.path.stat().st_size - sum(sizes.values())}

    def _stretches(self) -> StationRuns:
        held = self._store["stretches"]
        stretches = StationRuns(held["first"][()], held["chord"][()], held["reach_m"][()])
        scans = len(self._store["baselines/place"])
        if stretches.first[0] != 0 or stretches.first[-1] >= scans:
            found = f"{stretches.first[0]} to {stretches.first[-1]}"
            raise InputError(self.path, "/stretches/first", f"numbers from 0 to below {scans}", found)
        return stretches

    def _read_places(self, stations: Int[np.ndarray, " scan"]) -> StationPositions:
        assert self._place is not None
        return places_of_rows(self._place.read(stations))

    def _antennas(self, stations: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel 3"]:
        if self._antenna is None:
            return read_rows(self._store["baselines/antenna_m"], self.path, stations)
        return antennas_of_codes(self._antenna.read(stations), self.places.read(stations).pose)

    def _valid(self, stations: Int[np.ndarray, " scan"]) -> np.ndarray:
        return read_rows(self._store["baselines/valid"], self.path, stations).astype(bool)

    def _retired(self, stations: Int[np.ndarray, " scan"]) -> np.ndarray:
        if "retired" not in self._store["baselines"]:
            return np.zeros(len(stations), np.uint8)
        return read_rows(self._store["baselines/retired"], self.path, stations)

    def _precision(self) -> MapPrecision:
        if "code" not in self._store:
            return FULL
        return MapPrecision(str(attribute_of(self._store, "precision")), self._number("step_rms", "code"))

    def _description(self) -> MapDescription:
        store = self._store
        settings = json.loads(str(attribute_of(store, "chain")))
        try:
            chain = ChainSettings(**settings)
        except TypeError:
            expected = ", ".join(ChainSettings.__dataclass_fields__)
            raise InputError(self.path, "/@chain", expected, ", ".join(settings) or "nothing") from None
        # Drives follow one another.
        drives = 1 + int(self.places.read(np.array([len(self.places) - 1])).drive[0])
        weight = tuple(map(float, store["drives/weight"][()])) if "drives/weight" in store else ()
        if len(weight) not in (0, drives):
            raise InputError(self.path, "/drives/weight", f"a weight for each of {drives} drives", str(len(weight)))
        return MapDescription(
            name=str(attribute_of(store, "name")),
            frame=LocalFrame(*(self._number(f"anchor_{n}") for n in ("latitude_deg", "longitude_deg", "height_m"))),
            settings=chain,
            channel_pitch_m=self._number("channel_pitch_m"),
            channels=int(store["baselines/valid"].shape[1]),
            tile_spacing_m=self._number("tile_spacing_m"),
            gain=store["gain"][()],
            label_sigma_m=_label_sigmas(self.provenance, drives),
            weight=weight,
        )

    def _number(self, name: str, group: str = "/") -> float:
        value = attribute_of(self._store[group], name)
        if not isinstance(value, int | float):
            raise InputError(self.path, f"/@{name}", "a number", repr(value))
        return float(value)


def _label_sigmas(provenance: dict[str, object], drives: int) -> tuple[float, ...]:
    """Position sigma stated by each baseline's navigation; 0 if the map, or the drive, states none."""
    inputs = provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    said = [row.get("position_sigma_m") if isinstance(row, dict) else None for row in rows]
    known = [float(v) if isinstance(v, int | float) and 0.0 <= v < float("inf") else 0.0 for v in said[:drives]]
    return tuple(known + [0.0] * (drives - len(known)))


# A map's provenance: its baselines and updates.


class MapHistory(NamedTuple):
    """History of a map's baselines, from its provenance.

    Attributes:
        inputs: one row per baseline, empty if missing.
        updates: rows of the updates so far.
        agreement: median score of the matches of its first baselines, as far as that has been measured.
        repeats: share of each baseline's signal that is ground; NaN where not measured.
    """

    inputs: tuple[dict[str, Any], ...]
    updates: tuple[object, ...]
    agreement: Float[np.ndarray, "known known"]
    repeats: Float[np.ndarray, " drive"]

    @staticmethod
    def of(source: MapFile) -> "MapHistory":
        """History of a map."""
        drives = len(source.description.label_sigma_m)
        said, done = source.provenance.get("inputs"), source.provenance.get("updates")
        rows = [row if isinstance(row, dict) else {} for row in (said if isinstance(said, list) else [])][:drives]
        rows += [{}] * (drives - len(rows))
        agreement = _numbers(source.provenance.get("agreement"))
        square = agreement.ndim == 2 and agreement.shape[0] == agreement.shape[1]
        return MapHistory(
            inputs=tuple(rows),
            updates=tuple(done) if isinstance(done, list) else (),
            agreement=agreement if square else np.zeros((0, 0)),
            repeats=np.array([_number(row.get("repeats")) for row in rows]),
        )

    @property
    def added_by(self) -> tuple[int, ...]:
        """Number of the update that each baseline came with, 0 for those that the map was built from."""
        return tuple(int(row.get("update") or 0) for row in self.inputs)


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def _numbers(rows: object) -> Float[np.ndarray, "..."]:
    """A table of numbers and nulls; an empty one if it is invalid."""
    if not isinstance(rows, list) or not all(isinstance(row, list) and len(row) == len(rows) for row in rows):
        return np.zeros((0, 0))
    return np.array([[_number(value) for value in row] for row in rows]).reshape(len(rows), len(rows))
