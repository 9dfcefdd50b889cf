"""Faults in the closed loop of the runtime, in a bend: what is found, how fast, and what is done.

All of the list at several moments of a drive, and for longer: ``validation/loops/test_faults.py``.
"""

import pytest

from canon.course_moments import Moment, follow
from runtime.fault_cases import CASES, Case


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.number}-{case.name}")
def test_a_fault_is_answered_as_listed(moments: dict[str, Moment], case: Case) -> None:
    after = follow(moments["bend"], case.seconds, faults=case.faults)
    assert case.holds(after), after.told
