"""Progress bars on standard error, so that results on standard output stay clean."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

# Names of files and extras may hold brackets: none of what is printed is markup.
console = Console(markup=False)


@contextmanager
def progress_bar(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar that the block advances by calling what it yields."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(what, total=total)
        yield lambda done: progress.advance(task, done)


def working(what: str) -> AbstractContextManager[object]:
    """A sign of life for work whose length is not known."""
    return Console(stderr=True).status(what)
