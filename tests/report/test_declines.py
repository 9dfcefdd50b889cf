"""Declined scans in words: every code has its own, and the table counts what the codes say."""

import re
from dataclasses import replace

import numpy as np

from lgprjax.report import CODES, DECLINES, declines_table, main_decline, summarise
from report.synthetic import declined_drive, straight_drive


def test_every_code_that_is_no_position_is_in_words() -> None:
    assert set(DECLINES) == set(CODES) - {"ok"}
    assert len({decline.meaning for decline in DECLINES.values()}) == len(DECLINES)


def test_the_table_counts_by_code_the_most_frequent_first() -> None:
    drive = straight_drive()
    table = declines_table([summarise(drive), summarise(declined_drive())])
    assert table is not None
    counts = {code: int((drive.code == code).sum()) for code in DECLINES}
    expected = sorted((code for code in counts if counts[code]), key=lambda code: -counts[code])
    assert len(expected) == 3
    # The impostor's scans must be declined: there is nothing to do about them.
    assert [(row[0], row[1]) for row in table.rows] == [(drive.name, code) for code in expected]
    first = f"{counts[expected[0]]}, {100.0 * counts[expected[0]] / len(drive.code):.1f} %"
    assert table.rows[0][2:4] == (first, DECLINES[expected[0]].meaning)
    assert table.rows[0][4].endswith(DECLINES[expected[0]].action[1:])


def test_nothing_declined_is_no_table() -> None:
    drive = straight_drive()
    found = summarise(replace(drive, code=np.full(len(drive.code), "ok")))
    assert declines_table([found]) is None
    assert main_decline(found) is None


def test_a_drive_beside_the_map_is_told_how_far() -> None:
    drive = declined_drive()
    code, plain = main_decline(summarise(drive)) or ("", None)
    assert code == "low_correlation"
    assert plain is not None
    assert plain.meaning == DECLINES[code].meaning
    line = np.stack([drive.prior_east_m, drive.prior_north_m], axis=1)[::2] + np.array([30.0, -40.0])
    beside = main_decline(summarise(replace(drive, baseline_tracks=(line,))))
    assert beside is not None
    metres = re.search(r"([\d.]+) m ", beside[1].action)
    assert metres is not None
    assert 40.0 < float(metres[1]) < 50.1


def test_a_place_that_nobody_said_is_what_to_mend() -> None:
    """Off the map, and the place made up: say the place. Where it was recorded, or the ground declines, do not."""
    drive = straight_drive()
    lost = summarise(replace(drive, code=np.full(len(drive.code), "off_map")))
    assert main_decline(lost) == ("off_map", DECLINES["off_map"])
    assumed = main_decline(summarise(replace(drive, code=np.full(len(drive.code), "off_map"), place_assumed=True)))
    assert assumed is not None
    assert "--latitude-deg" in assumed[1].action
    assert "--latitude-deg" not in DECLINES["off_map"].action
    declined = main_decline(summarise(replace(declined_drive(), place_assumed=True)))
    assert declined == ("low_correlation", DECLINES["low_correlation"])
