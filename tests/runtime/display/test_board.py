"""What the display knows, how old it is, and which routes may be asked for."""

import json
from typing import Any

import pytest

from lgprjax.autopilot.modes import ENGAGED as ENGAGED_MODES
from lgprjax.autopilot.modes import Mode
from lgprjax.run_records import Record, RecordKind, Source, pack
from lgprjax.runtime.display.board import ENGAGED, STALE_NS, Board
from runtime.display.served_page import BROKEN, DRIVING, READY, state_record

NOW_NS = 5_000_000_000


def board_of(*states: dict[str, Any]) -> Board:
    board = Board()
    board.take([state_record(state, NOW_NS) for state in states])
    return board


def shown(board: Board, *, mono_ns: int = NOW_NS, with_path: bool = True) -> Any:
    return json.loads(board.text(mono_ns, 3, with_path=with_path), parse_constant=pytest.fail)


def test_the_newest_state_and_its_age() -> None:
    said = shown(board_of(READY, DRIVING), mono_ns=NOW_NS + 250_000_000)
    assert said["state"]["mode"] == "SPEED"
    assert said["age_s"] == pytest.approx(0.25)
    assert said["sent_s"] == pytest.approx(5.25)
    assert said["refused"] == 3


def test_before_the_first_state() -> None:
    said = shown(Board())
    assert said["state"] is None
    assert said["age_s"] is None
    assert said["path"] is None


def test_the_path_stays_until_the_route_changes() -> None:
    path = [[0.0, 0.0], [1.0, 2.0]]
    board = board_of(READY | {"path": path}, READY, READY | {"path": path})
    version = board.path_version
    assert shown(board)["path"] == path
    assert "path" not in shown(board, with_path=False)
    assert "path" not in shown(board)["state"]
    board.take([state_record(READY | {"path": path}, NOW_NS)])
    assert board.path_version == version
    board.take([state_record(READY | {"route": "quarry"}, NOW_NS)])
    assert board.path_version != version
    assert shown(board)["path"] is None


def test_numbers_that_are_none_do_not_reach_a_browser() -> None:
    payload = b'{"mode": "READY", "speed_mps": NaN, "sigma_along_m": Infinity, "to_go_m": -Infinity}'
    board = Board()
    board.take([pack(Record(RecordKind.STATE, Source.CONTROL, 1, NOW_NS, payload))])
    assert shown(board)["state"] == {"mode": "READY", "speed_mps": None, "sigma_along_m": None, "to_go_m": None}


def test_what_is_no_state_is_counted_and_changes_nothing() -> None:
    messages = [
        b"",
        b"\x09\x0a",
        state_record(DRIVING)[:-1],
        pack(Record(RecordKind.STATE, Source.CONTROL, 1, NOW_NS, b"[1]")),
        pack(Record(RecordKind.STATE, Source.CONTROL, 1, NOW_NS, b'{"a": 1e999}')),
        pack(Record(RecordKind.STATE, Source.CONTROL, 1, NOW_NS, b"[" * 100_000)),
        pack(Record(RecordKind.STATE, Source.CONTROL, 1, NOW_NS, b"\xff\xfe")),
        pack(Record(RecordKind.MONITOR, Source.CONTROL, 1, NOW_NS, b"{}")),
        b"\xff" + state_record(DRIVING)[1:],
    ]
    for message in messages:
        board = board_of(READY)
        board.take([message])
        assert board.refused_states == 1
        assert shown(board)["state"]["mode"] == "READY"


QUARRY = {"select_route": "quarry"}


def test_a_route_is_chosen_by_its_name_before_the_vehicle_steers_and_while_there_is_data() -> None:
    assert board_of(READY).obstacle(QUARRY, NOW_NS) is None
    assert board_of(READY).obstacle(QUARRY, NOW_NS + 500_000_000) is None
    steering = [DRIVING, DRIVING | {"mode": "STEERING"}, READY | {"mode": None}]
    no_names: list[Any] = [None, [None, 7, {}]]
    others = [
        {board.obstacle(QUARRY, NOW_NS) for board in map(board_of, steering)},
        {board_of(READY | {"routes": routes}).obstacle(QUARRY, NOW_NS) for routes in no_names}
        | {board_of(READY).obstacle({"select_route": "nowhere"}, NOW_NS)},
        {
            Board().obstacle(QUARRY, NOW_NS),
            board_of(READY).obstacle(QUARRY, NOW_NS + 500_000_001),
        },
        {board_of(READY).obstacle({"select_route": "old road"}, NOW_NS)},
    ]
    # Each obstacle has its own words.
    assert [len(words) for words in others] == [1] * 4
    assert len(set().union(*others) - {None}) == 4
    assert BROKEN["problem"] in str(board_of(READY).obstacle({"select_route": "old road"}, NOW_NS))


def test_engaged_as_the_mode_machine_has_it() -> None:
    assert tuple(Mode(mode).name for mode in ENGAGED_MODES) == ENGAGED


def worked_record(worked: object) -> bytes:
    return pack(Record(RecordKind.WORKED, Source.COVERAGE, 0, NOW_NS, json.dumps(worked).encode()))


def test_a_level_is_chosen_among_those_that_are_offered() -> None:
    board = board_of(READY)
    assert board.obstacle({"select_level": 0.95}, NOW_NS) is not None
    board.take_worked(
        [worked_record({"runs": [], "level": 0.95, "levels": [0.95, 0.996]}), worked_record({"shape": []})]
    )
    assert board.obstacle({"select_level": 0.996}, NOW_NS) is None
    assert board.obstacle({"select_level": 0.5}, NOW_NS) is not None
    assert board.obstacle({"select_level": 0.996}, NOW_NS + 2 * STALE_NS) is not None
    assert board.worked_version == 1
    assert shown(board)["shape"] == {"shape": []}


def test_what_is_worked_is_told_once_a_version_and_what_is_none_is_counted() -> None:
    board = board_of(READY)
    assert "worked" not in shown(board)
    board.take_worked([worked_record({"runs": [[0, 1, 2]], "level": 0.95})])
    assert board.worked_version == 1
    assert json.loads(board.text(NOW_NS, 0, with_path=False, with_worked=True))["worked"]["runs"] == [[0, 1, 2]]
    board.take_worked([])
    board.take_worked([worked_record([1, 2])])
    board.take_worked([pack(Record(RecordKind.WORKED, Source.COVERAGE, 0, NOW_NS, b'{"level": 1e999}'))])
    board.take_worked([b"short"])
    assert board.worked_version == 1
    assert board.refused_states == 3
