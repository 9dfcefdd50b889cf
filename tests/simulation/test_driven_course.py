"""Courses that full registration in the loop does not drive. One that it drives: ``validation/loops``."""

import jax.numpy as jnp
import pytest

from lgprjax.scene import no_faults
from lgprjax.simulation.loop import (
    LoopSpec,
    OffRoad,
)
from lgprjax.simulation.loop.driven_course import _refuse_drawn_faults, _scans_a_tick

_SPEC = LoopSpec()


def test_a_tick_of_broken_scans_and_a_fault_of_drawn_fixes_are_refused() -> None:
    for share in (4, 7):
        with pytest.raises(ValueError, match=f"scan_share {share}"):
            _scans_a_tick(OffRoad(7, 32.0, scan_share=share), _SPEC.tick_s)
    assert [_scans_a_tick(OffRoad(7, 32.0, scan_share=whole), _SPEC.tick_s) for whole in (1, 2, 3, 6)] == [6, 3, 2, 1]
    for fault in ("odometer_lost_s", "lgpr_wrong_s", "lgpr_faded_s"):
        with pytest.raises(ValueError, match=fault):
            _refuse_drawn_faults(no_faults()._replace(**{fault: jnp.asarray([5.0, 9.0])}))
    _refuse_drawn_faults(no_faults()._replace(lgpr_lost_s=jnp.asarray([5.0, 9.0])))
