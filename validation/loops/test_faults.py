"""The fault list of docs/onboard.md in the closed loop, each fault on a straight, in a bend and at speed."""

import pytest

from canon.course_moments import Moment, follow
from runtime.fault_cases import CASES, MORE_CASES, Case


@pytest.mark.parametrize("case", [*CASES, *MORE_CASES], ids=lambda case: f"{case.number}-{case.name}")
@pytest.mark.parametrize("moment", ["straight", "bend", "fast"])
def test_a_fault_is_answered_as_listed(moments: dict[str, Moment], moment: str, case: Case) -> None:
    after = follow(moments[moment], case.seconds + 3.0, faults=case.faults)
    assert case.holds(after), after.told
