"""The error for users: bad input, in one line that gives file, place, expected and found."""

from collections.abc import Iterable
from pathlib import Path


class InputError(ValueError):
    """Input that cannot be used.

    The message is always one line: ``FILE: PLACE: expected EXPECTED, found FOUND``. The command line prints
    it and exits with status 1; library users catch it as a ``ValueError``.
    """

    def __init__(self, file: str | Path, place: str, expected: str, found: str) -> None:
        self.file = str(file)
        self.place = place
        self.expected = expected
        self.found = found
        line = f"{file}: {place}: expected {expected}, found {found}"
        super().__init__(" ".join(line.split()))

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, ...]]:
        return (InputError, (self.file, self.place, self.expected, self.found))


class ArgumentError(InputError):
    """An argument out of its range, or arguments that do not go together.

    The place is the argument's name, of several their names parted by commas. The command line names the option of the
    same name in its place, and exits with status 2.
    """

    def __init__(self, argument: str, expected: str, found: str) -> None:
        super().__init__("call", argument, expected, found)

    def __reduce__(self) -> tuple[type["InputError"], tuple[str, ...]]:
        return (ArgumentError, (self.place, self.expected, self.found))


def refuse_own_input(output: Path, inputs: Iterable[Path]) -> None:
    """Refuse an output that is one of the files it is made from: replacing what exists is about older outputs.

    Raises:
        InputError: it is one of them.
    """
    if output.is_file() and any(path.is_file() and output.samefile(path) for path in inputs):
        raise InputError(output, "output", "a file that is not an input", "an input file")
