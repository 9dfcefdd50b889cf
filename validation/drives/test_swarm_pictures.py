"""The pictures of a drive that a swarm refined."""

from pathlib import Path

from canon.site import Site, register_site
from report.test_drive_pictures import SWARM, pictures


def test_a_swarm_is_drawn_where_one_searches(site: Site, tmp_path: Path) -> None:
    whole = {"trajectory.png", "confidence.png", "match.png", "map.png", "swarm.png"}
    assert pictures(site, register_site(site, "live"), SWARM, tmp_path, impostor=False) == whole
