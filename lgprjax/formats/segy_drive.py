"""A SEG-Y line as a drive log: on its own coordinates where they can be placed on the earth, else straight."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.parallel_lines import inputs_of, write_lines
from lgprjax.formats.positioned_lines import write_positioned_lines
from lgprjax.formats.profile import Profile
from lgprjax.formats.segy import read_segy
from lgprjax.formats.survey_track import Place, distances_m, utm_projection


def import_segy(
    path: str | Path,
    *,
    sample_interval_ns: float | None = None,
    time_zero_ns: float = 0.0,
    utm_zone: str | None = None,
    place: Place,
    length_m: float | None = None,
    output: str | Path,
    force: bool = False,
) -> bool:
    """Write one SEG-Y line as a drive log of one channel.

    Coordinates in degrees, or in metres of a UTM zone that is named, place every trace: traces stay as recorded and
    the heading follows their path. Otherwise the line leaves ``place`` straight along its heading, at the distances
    of its coordinates or evenly over ``length_m``.

    Args:
        path: the file.
        sample_interval_ns, time_zero_ns: see ``read_segy``.
        utm_zone: zone of coordinates in metres, such as ``19N``.
        place: origin and direction of a line that has no place on the earth.
        length_m: length of the line as measured by tape; coordinates then do not count.
        output: the drive log.
        force: replace an output that exists.

    Returns:
        Whether the line lies on its own coordinates, and ``place`` did not count.

    Raises:
        InputError: the file cannot be read or has no sample interval, or the line no length.
    """
    profile = read_segy(path, sample_interval_ns=sample_interval_ns, time_zero_ns=time_zero_ns)
    provenance: dict[str, object] = {
        "made_by": "lgprjax import segy",
        "inputs": inputs_of([path]),
        "revision": profile.metadata["revision"],
        "reading": profile.metadata["reading"],
        "utm_zone": utm_zone,
    }
    where = None if length_m is not None else _on_the_earth(profile, utm_zone)
    if where is not None:
        latitude_deg, longitude_deg = where
        write_positioned_lines(
            [profile],
            latitude_deg=[latitude_deg],
            longitude_deg=[longitude_deg],
            height_m=None,
            travel_m=[distances_m(latitude_deg, longitude_deg)],
            output=output,
            provenance=provenance,
            assumed={"odometry": "from the positions"},
            force=force,
        )
        return True
    write_lines(
        [profile],
        left_m=np.zeros(1),
        forward_m=np.zeros(1),
        place=place,
        output=output,
        provenance=provenance,
        assumed=place.assumed(),
        length_m=length_m,
        force=force,
    )
    return False


def _on_the_earth(
    profile: Profile, utm_zone: str | None
) -> tuple[Float[np.ndarray, " trace"], Float[np.ndarray, " trace"]] | None:
    """Latitude and longitude of the traces, where their coordinates and the options say them."""
    coordinates = profile.coordinates
    if coordinates is None:
        if utm_zone is not None:
            raise InputError(profile.path, "coordinates", "eastings and northings", str(profile.metadata["reading"]))
        return None
    if coordinates.kind == "degrees":
        return coordinates.y, coordinates.x
    if utm_zone is None:
        return None
    low, high = (f(np.stack([coordinates.x, coordinates.y]), axis=1) for f in (np.min, np.max))
    if low[0] < 1e5 or high[0] > 9e5 or low[1] < 0 or high[1] > 1e7:
        found = f"eastings {low[0]:.6g} to {high[0]:.6g}, northings {low[1]:.6g} to {high[1]:.6g}"
        raise InputError(profile.path, "coordinates", "UTM metres (easting 100000 to 900000)", found)
    longitude_deg, latitude_deg = utm_projection(profile.path, utm_zone)(coordinates.x, coordinates.y, inverse=True)
    return np.asarray(latitude_deg), np.asarray(longitude_deg)
