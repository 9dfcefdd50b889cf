"""What the ground of a map is made from: a subsurface database, on disk or in memory."""

from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings
from lgprjax.subsurface.station_places import StationPlaces


class MapDescription(NamedTuple):
    """What holds for a whole map.

    Attributes:
        name: of the map.
        frame: its local frame.
        settings: the chain that its baselines went through, and live scans must.
        channel_pitch_m: spacing of the array's channels.
        channels: largest number of channels of a baseline.
        tile_spacing_m: no station is farther than half of this from a tile frame.
        gain: depth gain of each profile sample.
        label_sigma_m: of each baseline, what its navigation said of its positions, root mean square over the drive
            and over east and north; 0 where it said nothing.
        weight: of each baseline's traces in gridding; empty where all weigh the same.
    """

    name: str
    frame: LocalFrame
    settings: ChainSettings
    channel_pitch_m: float
    channels: int
    tile_spacing_m: float
    gain: Float[np.ndarray, " sample"]
    label_sigma_m: tuple[float, ...] = ()
    weight: tuple[float, ...] = ()

    @property
    def array_width_m(self) -> float:
        """Width of the array, from half a pitch beside the first channel to half a pitch beside the last."""
        return self.channels * self.channel_pitch_m


class Stations(NamedTuple):
    """Stations read from a database; antennas as east and north offset from the pose, height above ground."""

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    antenna_m: Float[np.ndarray, "scan channel 3"]


@runtime_checkable
class StationSource(Protocol):
    """A subsurface database, open for reading.

    In memory are what holds for the whole map, its tile frames, and short stretches of its tracks (``places``).
    Poses and profiles are read for the stations that are needed: ``places.near(point_m, radius_m)`` gives numbers,
    ``places.read(numbers)`` pose, ground and baseline of each, ``read_stations(numbers)`` its profiles. A source whose
    poses are in memory has ``StationPlaces.held(Places(pose, ground_up_m, drive))``. Databases on disk
    (``formats.MapFile``) also have ``pose``, ``drive`` and ``ground_up_m`` of all stations, read whole when first asked
    for: nothing that registers may ask.
    """

    @property
    def description(self) -> MapDescription:
        """What holds for the whole map."""
        ...

    @property
    def places(self) -> StationPlaces:
        """Where the stations stand."""
        ...

    @property
    def tile_frame(self) -> Float[np.ndarray, "tile 3"]:
        """East, north and yaw of every tile."""
        ...

    @property
    def height_reference_m(self) -> Float[np.ndarray, " tile"]:
        """Antenna height that each tile is brought to."""
        ...

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these (rising) numbers."""
        ...
