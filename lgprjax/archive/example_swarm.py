"""The particle swarm of one fix, run again to be looked at."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.archive.registering import RegisteredDrive
from lgprjax.registration import RegisterOptions, SurfacePicture, SwarmView, Template, watch_finish
from lgprjax.registration.integrity import MIN_OVERLAP, independent_numbers
from lgprjax.subsurface import GroundMap, Tile


def swarm_about(
    ground: GroundMap,
    tile_number: int,
    template: Template,
    prior: Float[np.ndarray, "5"],
    surface: SurfacePicture,
    drive: RegisteredDrive,
    options: RegisterOptions,
    scan: int,
) -> SwarmView | None:
    """The swarm about the highest place of a scan's surface; None where no swarm is asked for, or nothing was found.

    The drive's own swarm began at the summits of its coarse stage, on columns: a few centimetres from there at most.

    Args:
        ground: the map.
        tile_number: of the tile that the scan was searched on.
        template: single, in a batch of one.
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad in the tile's frame.
        surface: of the scan over the search region.
        drive: that the scan is of.
        options: the search.
        scan: number in the drive.
    """
    scatter = float(np.asarray(drive.fix.scatter)[scan])
    if options.swarm is None or not np.isfinite(scatter) or not np.isfinite(surface.strength).any():
        return None
    i, j = np.unravel_index(int(np.nanargmax(surface.strength)), surface.strength.shape)
    whole = np.append(prior, 0.0)
    start = np.array([surface.along_m[i], surface.cross_m[j], *whole[2:]])
    half_width = options.half_width(drive.track.sigma_yaw_rad[[scan]], options.search_half_m(drive.track.sigma_m))[0]

    def single(values: Float[np.ndarray, "6"]) -> jnp.ndarray:
        return jnp.asarray(values, dtype=jnp.float32)

    tile: Tile = ground.tile(tile_number)
    view: SwarmView = watch_finish(
        tile,
        jnp.float32(ground.source.height_reference_m[tile_number]),
        ground.basis.angular_frequency_rad_per_ns,
        jnp.float32(MIN_OVERLAP),
        Template(*(field[0] for field in template)),
        single(start),
        single(whole),
        single(half_width),
        independent_numbers(jnp.float32(scatter)),
        jnp.asarray([True, True, True, template.valid.shape[1] > 1, drive.fix.overlap_channels.max() > 1, False]),
        jnp.uint32(options.seed),
        jnp.uint32(scan),
        config=options.swarm,
    )
    return SwarmView(*(np.asarray(field, np.float64) for field in view))
