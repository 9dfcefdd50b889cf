"""What a page may say: each request once, in order, for its own connection."""

import json
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.runtime.display.access import Refused, RequestGate

SESSION = "0123456789abcdef"
SECOND_NS = 1_000_000_000
MEADOW = {"select_route": "meadow"}


def said(**changed: Any) -> str:
    return json.dumps({"session": SESSION, "number": 1, "select_route": "meadow"} | changed)


def judge(message: str | bytes | None) -> dict[str, Any] | Refused:
    return RequestGate(SESSION).judge(message, 0)


def test_a_good_request() -> None:
    assert judge(said()) == MEADOW
    assert judge(said(select_route="Straße 4 <b>")) == {"select_route": "Straße 4 <b>"}
    assert judge(said(place="12.0 m along")) == MEADOW | {"place": "12.0 m along"}


def test_a_level_is_a_request_of_its_own() -> None:
    level = '{"session":"0123456789abcdef","number":1,"select_level":0.996}'
    assert judge(level) == {"select_level": 0.996}
    for other in ("1", "true", '"0.95"', "null", "[0.95]", '0.95,"select_route":"meadow"'):
        assert judge(level.replace("0.996", other)) is Refused.NOT_A_REQUEST


def test_numbers_rise() -> None:
    gate = RequestGate(SESSION)
    verdicts = [gate.judge(said(number=number), i * SECOND_NS) for i, number in enumerate([3, 3, 2, 4, 4, 900, 5])]
    again = Refused.REPEATED
    assert verdicts == [MEADOW, again, again, MEADOW, again, MEADOW, again]


def test_a_refused_message_uses_no_number() -> None:
    gate = RequestGate(SESSION)
    assert gate.judge(said(session="other", number=9), 0) is Refused.SESSION
    assert gate.judge(said(number=2), 0) == MEADOW


def test_anything_but_a_request() -> None:
    messages = [
        said(engage=True),
        '{"session":"0123456789abcdef","number":1,"engage":true}',
        '{"session":"0123456789abcdef","number":1}',
        *(said(number=number) for number in (True, 1.0, "1", 0, -1, 2**53, None)),
        said(session=7),
        *(said(select_route=route) for route in ("", None, ["meadow"], {"engage": True}, "m" * 201)),
        *(said(place=place) for place in ("", None, 1.0, ["12.0 m along"], "m" * 201)),
        *("[]", "1", "null", '"select_route"', "{}"),
    ]
    assert {judge(message) for message in messages} == {Refused.NOT_A_REQUEST}


def test_no_json_or_a_json_bomb() -> None:
    messages = [
        *("", "{", said() + "x", said()[:-1], "[" * 1000, '{"a":' * 200, "\x00", "9" * 1024),
        said().replace("1", "NaN"),
        said().replace("1", "-Infinity"),
        said().replace("1,", '1, "number": 2,'),
    ]
    assert {judge(message) for message in messages} <= {Refused.NOT_JSON, Refused.NOT_A_REQUEST}


def test_too_large_counts_bytes() -> None:
    assert judge(said() + " " * (1024 - len(said()))) == MEADOW
    assert judge(said() + " " * (1025 - len(said()))) is Refused.TOO_LARGE
    assert judge("ü" * 513) is Refused.TOO_LARGE


def test_bytes_are_no_text() -> None:
    assert judge(said().encode()) is Refused.NOT_TEXT
    assert judge(None) is Refused.NOT_TEXT


def test_five_a_second() -> None:
    gate = RequestGate(SESSION)
    times_ns = [i * SECOND_NS // 10 for i in range(10)]
    verdicts = [gate.judge(said(number=i + 1), at_ns) for i, at_ns in enumerate(times_ns)]
    assert verdicts == [MEADOW] * 5 + [Refused.TOO_MANY] * 5
    # The refused ones count too: who goes on shouting is not heard.
    assert gate.judge(said(number=50), times_ns[-1] + SECOND_NS * 9 // 10) == MEADOW


@settings(max_examples=50, deadline=None)
@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.text(max_size=8),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from(["session", "number", "select_route", "engage"]), inner, max_size=4)
        ),
        max_leaves=8,
    )
)
def test_nothing_else_is_taken_for_a_request(value: Any) -> None:
    assert isinstance(judge(json.dumps(value)), Refused)
    assert isinstance(judge(str(value)), Refused)
