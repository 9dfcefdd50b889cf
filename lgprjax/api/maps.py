"""Maps: subsurface databases built from drives, opened, and looked at."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Literal

from lgprjax.api.inputs import PathLike, axes_or_new, path_of, paths_of, require_number, told_as_arguments
from lgprjax.errors import InputError, refuse_own_input
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
    """A subsurface database, open for reading; a context manager that closes it.

    Gridded ground is kept from call to call, so that registering a second drive on an open map is quicker.

    Attributes:
        path: the file, ``M.map.h5``.
        name: of the map.
        stations: places along the baselines at which traces are stored.
        baselines: drives that it was built from.
        channels: of the radar array.
        length_m: of all baselines together.
        settings: of the processing of baselines and live scans.
        frame: the local frame; poses are in metres east and north of its origin.
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
        """Close the file; the attributes stay."""
        self.held, self._closed = None, True
        self._source.close()

    @property
    def source(self) -> MapFile:
        """The file that the map was opened from. Raises ``InputError`` once it is closed."""
        if self._closed:
            raise InputError(self.path, "file", "an open map", "closed: open it again")
        return self._source

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file in hexadecimal, read once; what is made from the map names it.

        Raises:
            InputError: the file was removed or replaced since it was opened.
        """
        with told_as_arguments():
            found = file_hash(self.path)
        # The open file stays what it was when another takes its name; that other one is not what fixes are made from.
        if self._stamp() != self._opened_as:
            raise InputError(self.path, "file", "the file that was opened", "one written since: open it again")
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
        """Scans of a drive, their priors and the ground beneath them, as arrays on the device, for ``match``.

        All scans of a batch are on one tile, so that they must be within 60 m of each other.

        Args:
            drive: a drive log or an open drive.
            scans: of the drive.
            options: of the search; their ``window_m`` and ``swarm`` are not looked at.
            window_m: length of the window that ends with each scan; 0 for the scan alone.

        Raises:
            InputError: no scans, scans too far apart, or a place off the map.
        """
        from lgprjax.api.matching import batch_of

        return batch_of(self, path_of(drive, "drive"), scans, options=options, window_m=window_m)

    def refine(self, output: PathLike, *, force: bool = False) -> "ChangedMap":
        """Make the baselines agree: each is registered on the others, its labels follow, a new map is written.

        Args:
            output: the database to write.
            force: replace a file that exists.

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
        """Add drives as baselines, weigh all baselines, and retire ground that two newer drives find changed.

        The drives are taken oldest first.

        Args:
            drives: drive logs or open drives over the map's ground.
            output: the database to write.
            force: replace a file that exists.

        Raises:
            InputError: a drive that does not fit or lies elsewhere, or an output that exists (without ``force``) or
                cannot be written.
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
    """A map that was made of another one, and what was done to it.

    Attributes:
        map: the new one, open.
        table: DataFrame of what was moved, in metres: one row a baseline of ``refine``, one a drive of ``update``.
        notes: the whole in words, a line each.
    """

    map: Map
    table: "pd.DataFrame"
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        return "\n".join([f"ChangedMap: {self.map!r}", *(f"  {note}" for note in self.notes)])


def open_map(path: PathLike) -> Map:
    """Open a subsurface database.

    Args:
        path: of the database, ``M.map.h5``.

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
    """Build a subsurface database from drives over the same ground.

    Args:
        drives: drive logs or open drives, the baselines. The first defines the map's origin and processing.
        output: the database to write, ``M.map.h5``.
        centre_frequency_mhz: of the antennas, if missing in the first log.
        travel_time_ns: largest two-way travel time of profiles; by default traces extend to the end of the recording
            and sweeps to fifteen periods.
        precision: of the stored traces: ``full`` as 16-bit samples, ``standard`` in about two bits per number,
            ``small`` in fewer.
        force: replace a file that exists.

    Returns:
        The map, open.

    Raises:
        InputError: an unusable log, drives that do not fit together, or an output that is one of them or cannot be
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
