"""A map whose baselines disagree -> a map whose baselines agree: labels corrected, no signal touched."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lgprjax import __version__
from lgprjax.archive.baseline_graph import AgreedBaselines, agree_baselines
from lgprjax.archive.baseline_matches import MatchPlan, match_again, match_passes
from lgprjax.archive.map_building import MEASURING
from lgprjax.archive.map_chance import measure_chance
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, MapWriter, copy_stations
from lgprjax.subsurface import TilePlacer

_BLOCK = 256  # stations that share a height when tiles are placed


def refine_map(
    source: MapFile,
    plan: MatchPlan,
    output: str | Path,
    *,
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
    stage: Callable[[str], None] = lambda _: None,
) -> AgreedBaselines:
    """Register a map's baselines on each other, make their labels consistent, and write the map they then make.

    Stations are copied as they are stored; their poses change, and with them the tiles. Baselines that are tied to
    nothing stay where they are. The new map says as much of its labels as the old one: where baselines agree on a mean
    of their labels, the mean of their sigmas, taken as independent, is what that mean is off by.

    Args:
        source: the map.
        plan: what to match (``plan_matches``).
        output: the new one.
        force: replace an output that exists.
        progress: told the number of matches done since the last call; each is done twice.
        stage: told what is done after the last match.

    Raises:
        InputError: the output exists or cannot be written, or the map holds damage.
    """
    # Now: the file may be replaced by an update while this one reads on in what it opened.
    digest = file_hash(source.path)
    with MapWriter.create(output, force=force) as writer:
        agreed = agree_twice(source, plan, progress)
        copy_stations(source, writer, agreed.pose)
        frames, references_m = _tiles(agreed.pose, source.drive, source.description.tile_spacing_m)
        name = Path(output).name.removesuffix(".map.h5")
        writer.finish(
            source.description._replace(name=name),
            frames,
            references_m,
            _provenance(source, digest, agreed),
            retired=source.retired,
        )
        stage(MEASURING)
        writer.add_chance(measure_chance)
    return agreed


def agree_twice(source: MapFile, plan: MatchPlan, progress: Callable[[int], None] = lambda _: None) -> AgreedBaselines:
    """Baselines made to agree from matches far about their labels, then from matches about where these put them.

    Args:
        source: the map.
        plan: what to match.
        progress: told the number of matches done since the last call; each is done twice.
    """
    first = agree_baselines(source, match_passes(source, plan, progress))
    correction = (first.pose - source.pose)[:, [0, 1, 3]]
    return agree_baselines(source, match_again(source, plan, correction, progress))


def _tiles(
    pose: Float[np.ndarray, "scan 5"], drive: Int[np.ndarray, " scan"], spacing_m: float
) -> tuple[Float[np.ndarray, "tile 3"], Float[np.ndarray, " tile"]]:
    """Tile frames along the corrected baselines, as a map is built, and the height of each."""
    placer = TilePlacer(spacing_m)
    references: list[float] = []
    for number in range(int(drive.max()) + 1):
        own = pose[drive == number]
        for low in range(0, len(own), _BLOCK):
            block = own[low : low + _BLOCK]
            references += [float(np.median(block[:, 2]))] * placer.place(block)
    return placer.frames, np.asarray(references)


def _provenance(source: MapFile, digest: str, agreed: AgreedBaselines) -> dict[str, object]:
    steps = source.provenance.get("steps")
    refined = {
        "map": source.path.name,
        "sha256": digest,
        "matches_used": agreed.used,
        "matches_kept": agreed.kept,
        "noise_scale": round(agreed.noise_scale, 3),
        "moved_rms_m": [round(change.moved_rms_m, 4) for change in agreed.baselines],
        "tied": [change.kept > 0 for change in agreed.baselines],
    }
    return {
        **source.provenance,
        "program": f"lgprjax {__version__}",
        "steps": [*(steps if isinstance(steps, list) else []), "labels made consistent by a pose graph"],
        "refined": refined,
    }
