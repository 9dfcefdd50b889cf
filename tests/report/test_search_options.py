"""What a page says of a search: the words follow the settings."""

from dataclasses import replace

import pytest

from lgprjax.batch import settings_of
from lgprjax.registration import RegisterOptions, Thresholds
from lgprjax.report.registered import search_in_words

OWN = RegisterOptions(window_m=2.0, own_thresholds=Thresholds(5.5, 2.5))


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (
            RegisterOptions(),
            [
                "within the position uncertainty stated by the log",
                "shortest window",
                "found along the drive",
                "risk 0.0001 in",
            ],
        ),
        (RegisterOptions(search_m=3.0, risk=1e-6), ["3 m to each side", "risk 1e-06 in each 4 m of travel"]),
        (RegisterOptions(window_m=0.0, time_scale=1.05), ["single scans", "time scale 1.05"]),
        (OWN, ["windows of 2 m", "user thresholds"]),
    ],
)
def test_words_follow_the_settings(options: RegisterOptions, said: list[str]) -> None:
    words = search_in_words(settings_of(options))
    assert all(each in words for each in said)
    assert ("risk" in words.split("; ")[-1]) == (options.own_thresholds is None)


def test_records_of_an_older_version_are_told_as_what_they_were() -> None:
    settings = settings_of(replace(OWN, own_thresholds=None))
    del settings["risk"]
    assert search_in_words(settings).endswith("; fixed thresholds.")
