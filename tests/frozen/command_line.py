"""The command line as it is told by ``--help``, and what it answers to wrong input."""

import re
from pathlib import Path
from typing import Any

from canon.commands import run

WRONG: dict[str, list[str]] = {
    "no verb": [],
    "unknown verb": ["localise"],
    "unknown option": ["check", "x.drive.h5", "--loud"],
    "no output": ["register", "text.map.h5", "empty.drive.h5"],
    "no output and no map": ["register", "nowhere.map.h5", "empty.drive.h5"],
    "no files": ["check"],
    "no map": ["register", "nowhere.map.h5", "x.drive.h5", "-o", "r"],
    "no drive": ["map", "build", "nowhere.drive.h5", "-o", "m.map.h5"],
    "no drives to register": ["register", "m.map.h5", "-o", "r"],
    "search too small": ["register", "m.map.h5", "x.drive.h5", "-o", "r", "--search-m", "0"],
    "scale too large": ["register", "m.map.h5", "x.drive.h5", "-o", "r", "--time-scale", "3"],
    "risk that is none": ["register", "m.map.h5", "x.drive.h5", "-o", "r", "--risk", "0.5"],
    "thresholds without window": ["register", "m.map.h5", "x.drive.h5", "-o", "r", "--thresholds", "t.toml"],
    "empty drive": ["check", "empty.drive.h5"],
    "drive of text": ["map", "info", "text.map.h5"],
    "frequency too low": ["map", "build", "x.drive.h5", "-o", "m.map.h5", "--centre-frequency-mhz", "0.1"],
    "no site": ["simulate", "nowhere.toml", "-o", "d"],
    "site with an unknown key": ["simulate", "wrong.toml", "-o", "d"],
    "no configuration": ["run", "nowhere.run.toml"],
    "two kinds of run": ["run", "nowhere.run.toml", "--simulate", "--preflight"],
    "no run": ["recover", "nowhere", "-o", "x.drive.h5"],
    "no study": ["tune", "nowhere.toml", "-o", "d"],
    "no plan": ["cover", "record", "run", "--plan", "nowhere.cover.geojson", "-o", "w.worked.h5"],
    "no field": ["cover", "plan", "nowhere.geojson", "-o", "p.cover.geojson", "--vehicle", "v.vehicle.toml"],
    "no record": ["cover", "export", "nowhere.worked.h5", "-o", "d"],
    "no route's map": ["route", "list", "nowhere.map.h5"],
    "no vendor's file": ["import", "nowhere.DT1", "-o", "x.drive.h5"],
    "unknown vendor": ["import", "text.map.h5", "-o", "x.drive.h5"],
    "nothing to view": ["view", "nowhere.DZT"],
    "nothing to export": ["export", "nowhere.drive.h5", "-o", "x.mcap"],
    "output of another kind": ["thresholds", "m.map.h5", "x.drive.h5", "-o", "t.toml", "--window-m", "-1"],
}
"""Words of commands that must be refused, run in a folder of ``write_wrong_files``."""
# An option begins its line of the table; what is said of it is set in.
_OPTION = re.compile(r"^  (-{1,2}[a-z]\S*.*?)(?:  +.*)?$")
_VERB = re.compile(r"^  ([a-z0-9]+) +\S")


def options_of_verbs() -> dict[str, list[str]]:
    """Every verb that does something, with its positional arguments and its options, as ``--help`` shows them."""
    found: dict[str, list[str]] = {}
    waiting: list[list[str]] = [[]]
    while waiting:
        words = waiting.pop()
        status, text, _ = run(*words, "--help")
        assert status == 0, words
        usage, _, rest = text.partition("\n\n")
        table, _, _ = rest.partition("\nExamples\n")
        if "COMMAND ..." in usage or "[FORMAT]" in usage:
            waiting += [[*words, verb[1]] for line in table.splitlines() if (verb := _VERB.match(line))]
            continue
        told = table.partition("Options\n")[2].splitlines()
        options = sorted(match[1].strip() for line in told if (match := _OPTION.match(line)))
        # What is left of the usage without what may be left out and without options that may not.
        needed = re.sub(r"\[[^]]*\]|-\S+ \S+", "", usage).split()[2 + len(words) :]
        found[" ".join(words)] = needed + options
    return dict(sorted(found.items()))


def write_wrong_files(folder: Path) -> None:
    """Files that ``WRONG`` names and that are not what their names say."""
    (folder / "empty.drive.h5").write_bytes(b"")
    (folder / "text.map.h5").write_text("a text\n", encoding="utf-8")
    (folder / "wrong.toml").write_text('name = "x"\ncolour = "red"\n[ground]\nlength_m = 60\n', encoding="utf-8")


def refusals() -> dict[str, list[Any]]:
    """Of every wrong command: exit status, what its answer is about, and the options that this names."""
    found: dict[str, list[Any]] = {}
    for name, words in WRONG.items():
        done = run(*words)
        # Without a verb all verbs are told.
        about = done.about if words else ""
        found[name] = [
            done.status,
            about,
            *sorted(set(re.findall(r"--[a-z-]+", done.err)) - {"--help"} if words else ()),
        ]
    return found
