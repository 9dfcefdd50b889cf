"""Error models of fixes on days of the generated off-road course, measured by driving it with full registration.

``lgprjax bench closed-loop`` drives the courses and tells the numbers again (``tuning.fit_fix_errors``).
"""

import jax.numpy as jnp

from lgprjax.scene.fix_errors import FixErrors

_DAYS: dict[str, dict[str, tuple[float, ...]]] = {
    "clear": {
        "slow_sigma": (0.0195, 0.0195, 0.0040),
        "slow_m": (4.25,),
        "white_sigma": (0.026, 0.017, 0.0009),
        "bias": (0.0, 0.0, 0.0),
        "reported_sigma": (0.030, 0.033, 0.0058),
        "found_m": (2.33,),
        "lost_m": (0.26,),
        "strength": (0.784,),
        "p_false": (5e-7,),
    },
}


def calibrated_fixes(weather: str) -> FixErrors:
    """The error model of a day.

    Raises:
        KeyError: a day that was not measured.
    """
    day = _DAYS[weather]
    return FixErrors(
        *(jnp.float32(day[n][0]) if len(day[n]) == 1 else jnp.asarray(day[n], jnp.float32) for n in FixErrors._fields)
    )
