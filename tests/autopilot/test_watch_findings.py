"""Findings: every bit has a severity and words, and the weightiest wins."""

from hypothesis import given
from hypothesis import strategies as st

from lgprjax.autopilot.monitors import FINDINGS, REFUSING, Severity, Watch, as_watch, describe, severity_of

MANUAL = {
    "POTENTIOMETER_RANGE",
    "POTENTIOMETER_STUCK",
    "WHEEL_SENSORS_APART",
    "SERVO_DEAD",
    "STEERING_RUNAWAY",
    "LINE_SILENT",
    "BAD_FRAMES",
    "DEFAULTS_ACT",
    "BUS_OFF",
    "SECOND_SENDER",
    "ACTUATOR_FAULT",
    "OVERRIDE_CONTACTS",
    "CONTROLLER_SILENT",
    "TORQUE_UNREAD",
    "HEADING_CONTRADICTED",
}
STOP = {"REAR_STUCK", "SPEED_UNKNOWN", "THROTTLE_STUCK", "PEDAL_UNREAD", "FAR_OFF_PATH", "ABOVE_LIMIT"}
EMERGENCY = {"SPEED_RISES", "BRAKE_DEAD"}
ONLY_TOLD = {"BRAKE_UNTESTED", "HEADING_UNCONFIRMED"}


def test_every_finding_asks_for_what_the_table_of_faults_says() -> None:
    for bit in Watch:
        name = str(bit.name)
        expected = Severity.DEGRADE
        for names, severity in (
            (MANUAL, Severity.MANUAL),
            (STOP, Severity.STOP),
            (EMERGENCY, Severity.EMERGENCY),
            (ONLY_TOLD, Severity.CONTINUE),
        ):
            expected = severity if name in names else expected
        assert FINDINGS[bit].severity is expected, name


def test_every_finding_has_words_of_its_own() -> None:
    assert set(FINDINGS) == set(Watch)
    assert len({each.text for each in FINDINGS.values()}) == len(Watch)


def test_findings_fit_a_record() -> None:
    assert max(Watch) < 2**32


def test_the_weightiest_comes_first() -> None:
    bits = Watch.SUPPLY_LOW | Watch.SPEED_RISES | Watch.REAR_STUCK
    assert describe(bits, FINDINGS) == [
        FINDINGS[bit].text for bit in (Watch.SPEED_RISES, Watch.REAR_STUCK, Watch.SUPPLY_LOW)
    ]
    assert describe(Watch(0), FINDINGS) == []


@given(st.sets(st.sampled_from(list(Watch))))
def test_severity_is_that_of_the_worst(found: set[Watch]) -> None:
    bits = as_watch(sum(int(bit) for bit in found))
    assert severity_of(bits, FINDINGS) == max([FINDINGS[bit].severity for bit in found], default=Severity.CONTINUE)


def test_what_refuses_to_engage() -> None:
    refused = {str(bit.name) for bit in REFUSING}
    # Off the path is where a vehicle that is to be engaged may well be.
    assert refused == (MANUAL | STOP | EMERGENCY | ONLY_TOLD) - {"FAR_OFF_PATH"}
