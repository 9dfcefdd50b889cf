"""The picture of a verified map's ground: passes and age, cell by cell."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lgprjax.archive import MapHealth
    from lgprjax.formats import MapFile


def draw_map_passes(source: "MapFile", health: "MapHealth", path: Path, *, force: bool) -> None:
    """Draw how often and how long before today a verified map's ground was passed.

    Raises:
        InputError: a part of the map is damaged; the file exists (without ``force``) or cannot be written.
    """
    from lgprjax.archive.map_passes import ground_passes, half_like_m
    from lgprjax.report import MapPasses, draw_passes

    ground = ground_passes(source, health.survey.route)
    now = datetime.now(UTC)
    today = (now - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds() / 86400.0
    draw_passes(
        MapPasses(
            name=health.name,
            at_m=ground.at_m,
            across_m=ground.across_m,
            passes=ground.passes,
            age_days=today - ground.newest_day,
            hole=ground.hole,
            half_like_m=half_like_m(health.survey, source.description.channel_pitch_m),
            today=f"{now:%Y-%m-%d}",
        ),
        path,
        force=force,
    )
