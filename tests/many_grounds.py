"""Maps that are not measured: where a test asks for places and not for how rare a false match is, minutes are saved."""

from lgprjax.formats import MapFile
from lgprjax.registration import Chance, pooled_chance


def of_many_grounds(source: MapFile) -> Chance:
    """What many grounds have, in place of ``measure_chance``."""
    return pooled_chance(source.description.settings.wavelength_m)
