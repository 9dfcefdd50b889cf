"""The subsurface database on disk: written station by station, read where registration asks."""

import json
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

import h5py
import numpy as np
from jaxtyping import Float, Int

from lgprjax.errors import InputError
from lgprjax.formats.hdf5_output import GuardedFile, create_store
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import (
    attribute_of,
    create_array,
    open_store,
    reading,
    validate_store,
    write_array,
    write_attribute,
)
from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings
from lgprjax.subsurface import MapDescription, StationBlock, Stations

_SCHEMA = load_schema("map")


class MapWriter:
    """A subsurface database being written; a context manager. It appears under its name when it is whole."""

    def __init__(self, path: Path, store: h5py.File, output: GuardedFile, cleanup: ExitStack) -> None:
        self.path = path
        self.stations = 0
        self._store = store
        self._output = output
        self._cleanup = cleanup

    @classmethod
    def create(cls, path: str | Path, *, force: bool = False) -> "MapWriter":
        """Begin a database. Raises ``InputError`` where the output cannot be written or exists."""
        with ExitStack() as cleanup:
            store, output = cleanup.enter_context(create_store(path, _SCHEMA, force))
            return cls(Path(path), store, output, cleanup.pop_all())
        raise AssertionError("unreachable: the stack passes exceptions on")

    def __enter__(self) -> "MapWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._cleanup.__exit__(kind, error, trace)
            return
        with self._cleanup:
            for finding in validate_store(self._store, self.path, _SCHEMA):
                if finding.severity == "error":
                    raise finding.error()

    def append(self, block: StationBlock, drive: int) -> None:
        """Append the next stations of a drive. All drives must have the same channels."""
        fields = {
            "traces": block.profile.astype(np.float16),
            "valid": block.valid,
            "pose": block.pose,
            "ground_up_m": block.ground_up_m,
            "antenna_m": block.antenna_m,
            "drive": np.full(len(block.pose), drive),
            "time_s": block.time_s,
        }
        for name, values in fields.items():
            path = f"/baselines/{name}"
            if path not in self._store:
                create_array(self._store, _SCHEMA, path, values.shape[1:])
            dataset = self._store[path]
            dataset.resize(self.stations + len(block.pose), axis=0)
            dataset[self.stations :] = values
        self.stations += len(block.pose)
        self._output.check()

    def finish(
        self,
        description: MapDescription,
        tile_frame: Float[np.ndarray, "tile 3"],
        height_reference_m: Float[np.ndarray, " tile"],
        provenance: dict[str, object],
    ) -> None:
        """Write what is known only at the end: gain, tiles, and what holds for the whole map."""
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
        }
        for name, value in attributes.items():
            write_attribute(store, name, value)
        write_array(store, _SCHEMA, "/gain", description.gain)
        write_array(store, _SCHEMA, "/tiles/frame", tile_frame)
        write_array(store, _SCHEMA, "/tiles/height_reference_m", height_reference_m)


class MapFile:
    """A subsurface database, open for reading; a context manager and a ``StationSource``.

    Poses are in memory (about 50 bytes a station); profiles are read where a tile needs them.
    """

    def __init__(self, path: Path, store: h5py.File) -> None:
        self.path = path
        self._store = store
        traces = store["baselines/traces"]
        settings = json.loads(str(attribute_of(store, "chain")))
        try:
            chain = ChainSettings(**settings)
        except TypeError:
            expected = ", ".join(ChainSettings.__dataclass_fields__)
            raise InputError(path, "/@chain", expected, ", ".join(settings) or "nothing") from None
        provenance: dict[str, object] = json.loads(str(attribute_of(store, "provenance")))
        self.description = MapDescription(
            name=str(attribute_of(store, "name")),
            frame=LocalFrame(*(self._number(f"anchor_{n}") for n in ("latitude_deg", "longitude_deg", "height_m"))),
            settings=chain,
            channel_pitch_m=self._number("channel_pitch_m"),
            channels=int(traces.shape[1]),
            tile_spacing_m=self._number("tile_spacing_m"),
            gain=store["gain"][()],
            label_sigma_m=_label_sigmas(provenance, 1 + int(store["baselines/drive"][()].max())),
        )
        self.provenance = provenance
        self.pose: Float[np.ndarray, "scan 5"] = store["baselines/pose"][()]
        self.ground_up_m: Float[np.ndarray, " scan"] = store["baselines/ground_up_m"][()]
        self.drive: Int[np.ndarray, " scan"] = store["baselines/drive"][()]
        self.tile_frame: Float[np.ndarray, "tile 3"] = store["tiles/frame"][()]
        self.height_reference_m: Float[np.ndarray, " tile"] = store["tiles/height_reference_m"][()]

    @classmethod
    def open(cls, path: str | Path) -> "MapFile":
        """Open a database. Raises ``InputError`` for the first thing that is not as the schema says."""
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

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these rising numbers, read run by run."""
        runs = np.split(stations, np.flatnonzero(np.diff(stations) > 1) + 1) if len(stations) else []

        def gather(name: str) -> np.ndarray:
            dataset = self._store[f"baselines/{name}"]
            if not runs:
                return np.zeros((0, *dataset.shape[1:]), dataset.dtype)
            return np.concatenate([dataset[int(run[0]) : int(run[-1]) + 1] for run in runs])

        with reading(self.path, "/baselines"):
            return Stations(
                profile=gather("traces").astype(np.float32),
                valid=gather("valid").astype(bool),
                antenna_m=gather("antenna_m"),
            )

    def _number(self, name: str) -> float:
        value = attribute_of(self._store, name)
        if not isinstance(value, int | float):
            raise InputError(self.path, f"/@{name}", "a number", repr(value))
        return float(value)


def _label_sigmas(provenance: dict[str, object], drives: int) -> tuple[float, ...]:
    """What each baseline's navigation said of its positions; 0 where the map, or the drive, does not say."""
    inputs = provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    said = [row.get("position_sigma_m") if isinstance(row, dict) else None for row in rows]
    known = [float(v) if isinstance(v, int | float) and 0.0 <= v < float("inf") else 0.0 for v in said[:drives]]
    return tuple(known + [0.0] * (drives - len(known)))
