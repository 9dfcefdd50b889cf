"""One site from its file to what is handed on, made by the command line alone, once a session.

A site is simulated, mapped and located on, by default and forced; everything is listed, checked, exported and imported
again; a field is planned, and a recorded run over it becomes a record of worked ground. All is computed by
``ONE_ARITHMETIC`` in a process of its own, which calls ``lgprjax.cli.main`` for one command after the other and keeps
what each said and which files it wrote.
"""

import json
import shutil
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from canon.commands import Done
from canon.shared import shared_folder
from frozen.harness import DATA, ROOT, run_commands
from frozen.recordings import lay_out

_ALL = "drives/live.drive.h5 drives/rain.drive.h5 drives/impostor.drive.h5"
_FORCED = "--window-m 2 --time-scale 1 --search-m 1"
COMMANDS = (
    "simulate site.toml -o drives",
    "simulate site.toml -o drives",
    "map build drives/left.drive.h5 drives/right.drive.h5 -o m.map.h5",
    "map info m.map.h5 --json info.json",
    "map build drives/left.drive.h5 -o small.map.h5 --centre-frequency-mhz 200 --precision small",
    "map info small.map.h5 --json -",
    f"register m.map.h5 {_ALL} -o default --workers 1 --threads 1",
    f"register m.map.h5 drives/live.drive.h5 -o forced {_FORCED} --json forced.json",
    f"register m.map.h5 drives/impostor.drive.h5 -o forced {_FORCED} --json -",
    f"register m.map.h5 drives/impostor.drive.h5 -o forced {_FORCED}",
    f"register m.map.h5 drives/impostor.drive.h5 -o forced {_FORCED} --force",
    "check m.map.h5 drives/live.drive.h5 default/live.fixes.h5 --json check.json",
    "check forced/live.fixes.csv forced/impostor.fixes.h5 drives/impostor.drive.h5",
    "compare forced default --json compared.json",
    "route list m.map.h5 --json routes.json",
    "route list m.map.h5 --json routes.json",
    "route select m.map.h5 left -o r.route.toml",
    "route export r.route.toml -o w.csv",
    "route export m.map.h5 left -o w.gpx",
    "route export m.map.h5 right -o w.geojson",
    "export drives/live.drive.h5 --fixes default/live.fixes.h5 -o live.mcap",
    "export drives/live.drive.h5 --fixes default/live.fixes.h5 -o live.mcap",
    "import mcap live.mcap -o again.drive.h5",
    "import mcap live.mcap -o again.drive.h5",
    "check again.drive.h5",
    "simulate vehicle.toml -o vehicle --only straight",
    "cover plan field.geojson -o p.cover.geojson --vehicle flail.vehicle.toml --order zamboni",
    "cover record field/run --plan field/field.cover.geojson -o f.worked.h5 --json worked.json",
    "cover export f.worked.h5 -o handover --organisation Us --json handover.json",
)
"""In their order; a command that stands there again is refused, as its output exists."""


class Step(NamedTuple):
    """A command, what it said, and the files that it wrote or wrote again."""

    words: str
    done: Done
    wrote: frozenset[str]


class Story(NamedTuple):
    """The folder, and the commands in their order."""

    folder: Path
    steps: tuple[Step, ...]

    def step(self, words: str, time: int = 0) -> Step:
        """The command that begins with these words, or that comes so many commands of this beginning later."""
        return [step for step in self.steps if step.words.startswith(words)][time]

    def json(self, name: str) -> Any:
        """A file of figures."""
        return json.loads((self.folder / name).read_text(encoding="utf-8"))


def make_story(folder: Path) -> None:
    """Run all commands in an empty folder."""
    shutil.copyfile(DATA / "site.toml", folder / "site.toml")
    shutil.copyfile(ROOT / "tuning" / "drives.toml", folder / "vehicle.toml")
    shutil.copyfile(ROOT / "onboard" / "field.geojson", folder / "field.geojson")
    shutil.copyfile(ROOT / "onboard" / "made_up_flail.vehicle.toml", folder / "flail.vehicle.toml")
    lay_out("field", folder / "field")
    told = run_commands([command.split() for command in COMMANDS], folder)
    (folder / "told.json").write_text(json.dumps(told), encoding="utf-8")


def story_in(folder: Path) -> Story:
    """What ``make_story`` made."""
    told = json.loads((folder / "told.json").read_text(encoding="utf-8"))
    steps = (
        Step(words, Done(one["status"], one["out"], one["err"]), frozenset(one["wrote"]))
        for words, one in zip(COMMANDS, told, strict=True)
    )
    return Story(folder, tuple(steps))


def story_of(factory: pytest.TempPathFactory) -> Story:
    """The session's."""
    return story_in(shared_folder(factory, "story", make_story))
