"""Progress bars on standard error, so that results on standard output stay clean."""

from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

# Names of files and extras may hold brackets: none of what is printed is markup.
console = Console(markup=False)


class Bar:
    """A bar on the screen: call it with how much has been done since the last call."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def __call__(self, done: int) -> None:
        """Advance."""
        self._progress.advance(self._task, done)

    def stage(self, what: str) -> None:
        """Say what is being done now."""
        self._progress.update(self._task, description=what)


@contextmanager
def progress_bar(what: str, total: int) -> Iterator[Bar]:
    """A bar that the block advances by calling what it yields."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        yield Bar(progress, progress.add_task(what, total=total))


def working(what: str) -> AbstractContextManager[object]:
    """A sign of life for work whose length is not known."""
    return Console(stderr=True).status(what)
