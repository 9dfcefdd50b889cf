"""Two small worlds: short routes, so that both take seconds."""

from dataclasses import replace

from validation.worlds.parameters import World, read_worlds

_TABLE = read_worlds()

SMALL_WORLDS: tuple[World, ...] = (
    # An array on a bend, eight bits, nothing said of its position.
    replace(
        _TABLE[18],
        number=100,
        seed=5001,
        channels=6,
        pass_spacing_m=0.8,
        route_m=16.0,
        scan_spacing_m=0.055,
        samples=180,
        gnss_east_m=0.7,
        gnss_north_m=-0.5,
        gnss_stated=False,
    ),
    # Lines of two channels, straight.
    replace(
        _TABLE[26],
        number=101,
        seed=5002,
        route_m=15.0,
        scan_spacing_m=0.055,
        samples=180,
        gnss_east_m=0.4,
        gnss_north_m=0.5,
        lookalike_m=0.0,
        lookalike_memory=0.0,
    ),
)
