"""lgprjax: locate a vehicle by the ground beneath it, with ground-penetrating radar, on JAX.

``import lgprjax as lx`` gives the public names listed in ``__all__``; docs/api.md lists them. A
name is loaded when it is first used, so that the import itself is cheap.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from lgprjax.api.coverage import open_worked as open_worked
    from lgprjax.api.coverage import plan_coverage as plan_coverage
    from lgprjax.api.coverage import record_coverage as record_coverage
    from lgprjax.api.drives import open_drive as open_drive
    from lgprjax.api.drives import simulate as simulate
    from lgprjax.api.files import check as check
    from lgprjax.api.files import view as view
    from lgprjax.api.fixes import locate as locate
    from lgprjax.api.fixes import register as register
    from lgprjax.api.fixes import register_many as register_many
    from lgprjax.api.maps import build_map as build_map
    from lgprjax.api.maps import open_map as open_map
    from lgprjax.api.matching import match as match
    from lgprjax.api.rollouts import course as course
    from lgprjax.api.rollouts import rollout as rollout
    from lgprjax.api.rollouts import tracking_cost as tracking_cost
    from lgprjax.api.vehicles import open_vehicle as open_vehicle
    from lgprjax.api.vehicles import tune as tune
    from lgprjax.api.zoom import zoom as zoom
    from lgprjax.pso import SwarmConfig as SwarmConfig
    from lgprjax.pso import run_swarm as run_swarm
    from lgprjax.registration import Code as Code
    from lgprjax.registration import Fix as Fix
    from lgprjax.registration import RegisterOptions as RegisterOptions

__version__ = "0.2.0"

_MODULE_OF = {
    "simulate": "lgprjax.api.drives",
    "open_drive": "lgprjax.api.drives",
    "check": "lgprjax.api.files",
    "view": "lgprjax.api.files",
    "zoom": "lgprjax.api.zoom",
    "build_map": "lgprjax.api.maps",
    "open_map": "lgprjax.api.maps",
    "register": "lgprjax.api.fixes",
    "register_many": "lgprjax.api.fixes",
    "locate": "lgprjax.api.fixes",
    "RegisterOptions": "lgprjax.registration",
    "Fix": "lgprjax.registration",
    "Code": "lgprjax.registration",
    "match": "lgprjax.api.matching",
    "run_swarm": "lgprjax.pso",
    "SwarmConfig": "lgprjax.pso",
    "open_vehicle": "lgprjax.api.vehicles",
    "course": "lgprjax.api.rollouts",
    "rollout": "lgprjax.api.rollouts",
    "tracking_cost": "lgprjax.api.rollouts",
    "tune": "lgprjax.api.vehicles",
    "plan_coverage": "lgprjax.api.coverage",
    "record_coverage": "lgprjax.api.coverage",
    "open_worked": "lgprjax.api.coverage",
}

__all__ = [  # noqa: RUF022  # in the order of use, which is that of docs/api.md
    "simulate",
    "open_drive",
    "check",
    "view",
    "zoom",
    "build_map",
    "open_map",
    "register",
    "register_many",
    "locate",
    "RegisterOptions",
    "Fix",
    "Code",
    "match",
    "run_swarm",
    "SwarmConfig",
    "open_vehicle",
    "course",
    "rollout",
    "tracking_cost",
    "tune",
    "plan_coverage",
    "record_coverage",
    "open_worked",
]


if not TYPE_CHECKING:  # or a type checker would take any name for one of these

    def __getattr__(name: str) -> object:
        """Load a public name on first use (PEP 562)."""
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = getattr(importlib.import_module(_MODULE_OF[name]), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
