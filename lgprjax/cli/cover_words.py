"""What the verbs of ``lgprjax cover`` say alike."""

from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from lgprjax.cli.progress import console
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive.cover_figures import CoverFigures


def refuse_existing(outputs: tuple[Path | None, ...], force: bool) -> None:
    """Refuse, before any work, outputs that are there already. Raises ``InputError`` for the first."""
    for path in outputs:
        if path is not None and path.exists() and not force:
            raise InputError(path, "output", "a new file, or --force", "the file exists")


def print_cover_figures(title: str, figures: "CoverFigures") -> None:
    """Print what a record says, and what it does not."""
    from lgprjax.archive.cover_figures import percent, square_metres

    table = Table("layer", "processed", "uncertain", "not processed", "of the field", title=title)
    for layer in figures.layers:
        areas = (square_metres(each) for each in (layer.processed_m2, layer.uncertain_m2, layer.not_processed_m2))
        table.add_row(f"{100.0 * layer.level:g} %", *areas, percent(layer.share))
    console.print(table)
    stops = sum(figures.stops.values())
    say(f"passes: {figures.passes}, {figures.way_m:.0f} m; stops: {stops}; {figures.hours:.2f} h")
    for layer in figures.layers:
        say(layer.sentence)
    say("A machine pass is not clearance: the ground is to be searched before it is released.")


def say(text: str) -> None:
    """Print a line as it is."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)
