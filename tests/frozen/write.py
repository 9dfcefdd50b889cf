"""Writes what is frozen again; see ``harness`` for when and how."""

import contextlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from canon.story import make_story
from frozen.autopilot_sequences import sequences
from frozen.command_line import options_of_verbs, refusals, write_wrong_files
from frozen.harness import DATA, write_json
from frozen.made import fixes_of
from frozen.structure import messages_of, schema_digests, structures


def write_commands() -> None:
    """``commands.json``, ``refusals.json``."""
    os.environ["COLUMNS"] = "100"
    write_json("commands.json", options_of_verbs())
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        write_wrong_files(Path(folder))
        write_json("refusals.json", refusals())


def write_sequences() -> None:
    """``sequences.json``."""
    write_json("sequences.json", sequences())


def write_made(*, fixes: bool, formats: bool) -> None:
    """``fixes.csv``; ``formats.json``, ``messages.json``, ``schemas.json``."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_story(folder)
        if fixes:
            fixes_of(folder).to_csv(DATA / "fixes.csv", index=False)
        if formats:
            write_json("formats.json", structures(folder))
            write_json("messages.json", messages_of(folder / "live.mcap"))
            write_json("schemas.json", schema_digests())


WRITERS: dict[str, Callable[[], None]] = {
    "commands": write_commands,
    "sequences": write_sequences,
    "fixes": lambda: write_made(fixes=True, formats=False),
    "formats": lambda: write_made(fixes=False, formats=True),
}

if __name__ == "__main__":
    for name in sys.argv[1:] or WRITERS:
        WRITERS[name]()
        print(f"{DATA}: {name}")
