"""Refusals are tested by their fields, never by their sentences, so that a sentence can be improved in one place."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import pytest

from lgprjax.errors import InputError
from lgprjax.tuning.robust import NotExcitedError

_LINE = re.compile(
    r"^(?:lgprjax|error): (?:(?P<file>\S.*?): )?(?P<place>[^:]+): expected (?P<expected>.*), found (?P<found>.*?)"
    r"(?: \(see lgprjax [a-z ]*--help\))?$"
)


class Refusal(NamedTuple):
    """Fields of an input error.

    Attributes:
        file: path of the file, empty where a command line names an option instead.
        place: option, dataset, key or row.
        expected: text that names the accepted values.
        found: text that names the value found.
    """

    file: str
    place: str
    expected: str
    found: str

    def check(
        self,
        place: str | None = None,
        *values: object,
        file: str | Path | None = None,
        found: object = None,
    ) -> None:
        """Compare with the fields of a test.

        Args:
            place: the whole place.
            values: each must be named in what was expected or found. Numbers, units, names of files, keys and options:
                values, not words of the sentence.
            file: path, or its last part.
            found: a value that must be named in what was found.
        """
        if place is not None:
            assert self.place == place, self
        if file is not None:
            assert self.file == str(file) or Path(self.file).name == str(file), self
        for value in values:
            assert str(value) in f"{self.expected} {self.found}", (value, self)
        if found is not None:
            assert str(found) in self.found, (found, self)


@contextmanager
def refused(
    place: str | None = None,
    *values: object,
    file: str | Path | None = None,
    found: object = None,
    error: type[InputError] | type[NotExcitedError] = InputError,
) -> Iterator[None]:
    """Expect the body to be refused with these fields; the arguments are those of ``Refusal.check``."""
    with pytest.raises(error) as caught:
        yield
    refusal_in(caught.value).check(place, *values, file=file, found=found)


def refusal_in(error: BaseException) -> Refusal:
    """Fields of an error that was raised."""
    if isinstance(error, NotExcitedError):
        return Refusal("", error.what, error.expected, error.found)
    assert isinstance(error, InputError), error
    assert "\n" not in str(error)
    return Refusal(error.file, error.place, error.expected, error.found)


def printed_refusal(text: str) -> Refusal:
    """Fields of the one line that a command printed; any other output fails."""
    (line,) = text.strip().splitlines()
    match = _LINE.match(line)
    assert match is not None, line
    return Refusal(match["file"] or "", match["place"], match["expected"], match["found"])
