"""Maps: subsurface databases built from drives, opened, and looked at."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal

from lgprjax.api.inputs import PathLike, axes_or_new, path_of, paths_of, require_number, told_as_arguments
from lgprjax.errors import ArgumentError, InputError, refuse_own_input
from lgprjax.files import file_hash
from lgprjax.formats import MapFile

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from lgprjax.api.matching import Batch
    from lgprjax.batch import HeldGround
    from lgprjax.frames import LocalFrame
    from lgprjax.radar import ChainSettings
    from lgprjax.registration import RegisterOptions


class Map:
    """A map (subsurface database), open for reading; a context manager that closes it.

    An open map caches gridded ground between calls; the second registration is faster.

    Attributes:
        path: map file, ``M.map.h5``.
        name: name of the map.
        stations: number of positions with stored traces along the baselines.
        baselines: number of drives in the map.
        channels: number of channels of the radar array.
        length_m: total length of the baselines, m.
        settings: processing of baselines and live scans.
        frame: local frame; poses are in metres east and north of its origin.
    """

    def __init__(self, source: MapFile) -> None:
        self._source, self._closed = source, False
        self.path: Path = source.path.absolute()
        self._opened_as = self._stamp()
        known = source.description
        self.name: str = known.name
        self.stations = len(source.places)
        self.baselines = len(known.label_sigma_m)
        self.channels: int = known.channels
        self.settings: ChainSettings = known.settings
        self.frame: LocalFrame = known.frame
        self.length_m = max(self.stations - self.baselines, 0) * known.settings.step_m
        self.held: tuple[RegisterOptions, HeldGround] | None = None

    def __repr__(self) -> str:
        chain = self.settings
        return (
            f"Map {self.name!r}: {self.stations} stations of {self.channels} channels on {self.baselines} baselines, "
            f"{self.length_m:.0f} m; a station every {100.0 * chain.step_m:.3g} cm, "
            f"{1e-6 * chain.band_low_hz:.3g} to {1e-6 * chain.band_high_hz:.3g} MHz ({self.path.name})"
        )

    def __enter__(self) -> "Map":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; the attributes remain."""
        self.held, self._closed = None, True
        self._source.close()

    @property
    def source(self) -> MapFile:
        """The file that the map was opened from. Raises ``InputError`` once it is closed."""
        if self._closed:
            raise InputError(self.path, "file", "an open map", "a closed map: open it again")
        return self._source

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the map file in hexadecimal; files made from the map contain it.

        Raises:
            InputError: the file was removed or replaced since it was opened.
        """
        with told_as_arguments():
            found = file_hash(self.path)
        # The open file stays what it was when another takes its name; that other one is not what fixes are made from.
        if self._stamp() != self._opened_as:
            raise InputError(self.path, "file", "the map file as opened", "a changed file: open it again")
        return found

    def _stamp(self) -> tuple[int, int]:
        status = self.path.stat()
        return status.st_size, status.st_mtime_ns

    def batch(
        self,
        drive: PathLike,
        scans: slice = slice(None),
        *,
        options: "RegisterOptions | None" = None,
        window_m: float = 0.0,
    ) -> "Batch":
        """Arrays on the device for ``match``: scans of a drive, their priors and the ground around them.

        All scans of a batch are on one tile and within 60 m of each other.

        Args:
            drive: drive log or open drive.
            scans: scans of the drive.
            options: search options; ``window_m`` and ``swarm`` are ignored.
            window_m: length of the window of travel that ends with each scan, m; 0 for single scans.

        Raises:
            InputError: no scans, scans too far apart, or scans off the map.
        """
        from lgprjax.api.matching import batch_of
        from lgprjax.registration import RegisterOptions

        options = RegisterOptions() if options is None else options
        check_options(options, self)
        path = path_of(drive, "drive")
        return batch_of(self.source, held_ground(self, options), path, scans, options=options, window_m=window_m)

    def refine(self, output: PathLike, *, force: bool = False) -> "ChangedMap":
        """Align the baselines: register each on the others, correct its position labels, write a new map.

        Args:
            output: map to write.
            force: replace an existing file.

        Raises:
            InputError: the output exists (without ``force``) or cannot be written, or the map is damaged.
        """
        import pandas as pd

        from lgprjax.formats import locked_map
        from lgprjax.mapping.align import agreement_in_words, baseline_files, plan_matches, refine_map

        file = path_of(output, "map")
        refuse_own_input(file, [self.path])
        with told_as_arguments(), locked_map(file):
            agreed = refine_map(self.source, plan_matches(self.source), file, force=force)
        files = baseline_files(self.source)
        table = pd.DataFrame([change._asdict() for change in agreed.baselines])
        table = table.rename(columns={"drive": "baseline", "kept": "believed"})
        table.insert(1, "file", files)
        return ChangedMap(open_map(file), table, tuple(agreement_in_words(agreed, files)))

    def update(self, drives: PathLike | Iterable[PathLike], output: PathLike, *, force: bool = False) -> "ChangedMap":
        """Add drives as baselines, weight all baselines, and retire ground that two newer drives find changed.

        Drives are added oldest first.

        Args:
            drives: drive logs or open drives over the map.
            output: map to write.
            force: replace an existing file.

        Raises:
            InputError: a drive does not fit or is outside the map, or the output exists (without ``force``) or cannot
                be written.
        """
        import pandas as pd

        from lgprjax.mapping import update_map
        from lgprjax.mapping.weights import changes_in_words

        file = path_of(output, "map")
        with told_as_arguments():
            told = update_map(self.path, paths_of(drives, "drive"), file, force=force)
        rows = [{**drive._asdict(), "changed": len(drive.changed)} for drive in told.drives]
        changes = [line for drive in told.drives for line in changes_in_words(drive, told.files)]
        weights = [
            f"baseline {number} ({name}) has weight {each.weight:.2f}: {each.reasons}"
            for number, (name, each) in enumerate(zip(told.files, told.weights, strict=True))
        ]
        return ChangedMap(open_map(file), pd.DataFrame(rows), (*changes, *weights))

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw the baselines from above, in metres east and north of the map's origin, and return the axes."""
        axes = axes_or_new(ax)
        for number in range(self.baselines):
            own = self.source.pose[self.source.drive == number]
            axes.plot(own[:, 0], own[:, 1], linewidth=1.5, label=f"baseline {number}")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        axes.set_title(f"Map {self.name}")
        axes.legend()
        return axes


@dataclass(frozen=True, eq=False)
class ChangedMap:
    """A new map made from another map, with the changes.

    Attributes:
        map: the new map, open.
        table: DataFrame of the corrections in metres, a row per baseline (``refine``) or per drive (``update``).
        notes: the changes in words.
    """

    map: Map
    table: "pd.DataFrame"
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join([f"ChangedMap: {self.map!r}", *(f"  {note}" for note in self.notes)])


def open_map(path: PathLike) -> Map:
    """Open a map (subsurface database).

    Args:
        path: map file, ``M.map.h5``.

    Raises:
        InputError: the file is missing, damaged, or does not match data_schema/map.toml.

    Example:
        with lx.open_map("site.map.h5") as site:
            print(site)                    # Map 'site': 3268 stations of 11 channels on 2 baselines, 131 m; ...
            site.plot()
    """
    return Map(MapFile.open(path_of(path, "map")))


def build_map(
    drives: PathLike | Iterable[PathLike],
    output: PathLike,
    *,
    centre_frequency_mhz: float | None = None,
    travel_time_ns: float | None = None,
    precision: Literal["full", "standard", "small"] = "standard",
    force: bool = False,
) -> Map:
    """Build a map (subsurface database) from drives over the same ground.

    Args:
        drives: drive logs or open drives, the baselines. The first defines origin and processing of the map.
        output: map to write, ``M.map.h5``.
        centre_frequency_mhz: centre frequency of the antennas, MHz, if the first log does not contain it.
        travel_time_ns: maximum two-way travel time of the profiles, ns; default: the end of the recording, for sweeps
            15 periods.
        precision: precision of the stored traces: ``full`` (16-bit samples), ``standard`` (about two bits per value),
            ``small`` (fewer bits).
        force: replace an existing file.

    Returns:
        The map, open.

    Raises:
        InputError: a log cannot be used, the drives do not fit together, or the output is one of them or cannot be
            written.

    Example:
        site = lx.build_map(["drives/baseline_left.drive.h5"], "left.map.h5", force=True)
        print(site.stations, site.settings.step_m)
    """
    from lgprjax.formats import MAP_PRECISIONS, locked_map
    from lgprjax.mapping import build_map as build

    baselines = paths_of(drives, "drive")
    file = path_of(output, "map")
    if precision not in MAP_PRECISIONS:
        raise InputError(file, "precision", ", ".join(MAP_PRECISIONS), repr(precision))
    for name, value, most in (
        ("centre_frequency_mhz", centre_frequency_mhz, 1e4),
        ("travel_time_ns", travel_time_ns, 1e5),
    ):
        if value is not None:
            require_number(name, value, f"1 to {most:g}", 1.0, most)
    refuse_own_input(file, baselines)
    with told_as_arguments(), locked_map(file):
        build(
            baselines,
            file,
            centre_frequency_hz=None if centre_frequency_mhz is None else 1e6 * centre_frequency_mhz,
            travel_time_ns=travel_time_ns,
            precision=MAP_PRECISIONS[precision],
            force=force,
        )
    return open_map(file)


def check_options(options: "RegisterOptions", site: Map) -> None:
    """Refuse invalid search options.

    Raises:
        InputError: an option is out of its range, or the search region is too small or too large for this map.
    """
    from lgprjax.batch import check_region, check_search
    from lgprjax.registration import RegisterOptions

    if not isinstance(options, RegisterOptions):
        raise ArgumentError("options", "RegisterOptions", repr(options)[:60])
    check_search(options)
    check_region(options.search_m, site.source)


def held_ground(site: Map, options: "RegisterOptions") -> "HeldGround":
    """Tiles and noise floor of a map for a search, cached in it until another search is used."""
    from lgprjax.batch import HeldGround

    if site.held is None or site.held[0] != options:
        site.held = (options, HeldGround(site.source, options))
    return site.held[1]


@contextmanager
def using_map(given: PathLike) -> Iterator[Map]:
    """Context of a map: an open one stays open, one opened here is closed again."""
    if isinstance(given, Map):
        yield given
        return
    with open_map(given) as opened:
        yield opened
