"""``lgprjax VERB``."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import tyro

from lgprjax.cli.cover import CoverVerb
from lgprjax.cli.data import CheckVerb, Examples, Export, Recover
from lgprjax.cli.doctor import Doctor
from lgprjax.cli.events import Events
from lgprjax.cli.imports import ImportVerb, recognised
from lgprjax.cli.maps import MapVerb
from lgprjax.cli.register import Register
from lgprjax.cli.route import RouteVerb
from lgprjax.cli.run import Run
from lgprjax.cli.simulate import Demo, Simulate
from lgprjax.cli.terminal import run_verb
from lgprjax.cli.tune import ThresholdsVerb, Tune
from lgprjax.cli.view import View

_DESCRIPTION = """Localizing ground-penetrating radar: locate a vehicle by the ground beneath it.

A recorded drive becomes a map; later drives are located against it. Typical order: import (or record) drive logs,
map build, register. Exit status: 0 success, 1 bad input (one line gives file, place, expected and found), 2 wrong
usage."""

Verb = (
    Annotated[Demo, tyro.conf.subcommand("demo")]
    | Annotated[
        ImportVerb,
        tyro.conf.subcommand("import", description="Convert vendor files to drive logs: import FILE..., or by format."),
    ]
    | Annotated[View, tyro.conf.subcommand("view")]
    | Annotated[CheckVerb, tyro.conf.subcommand("check")]
    | Annotated[MapVerb, tyro.conf.subcommand("map", description="Subsurface databases.")]
    | Annotated[Register, tyro.conf.subcommand("register")]
    | Annotated[Export, tyro.conf.subcommand("export")]
    | Annotated[
        RouteVerb, tyro.conf.subcommand("route", description="List, select and export routes of a subsurface database.")
    ]
    | Annotated[CoverVerb, tyro.conf.subcommand("cover", description="Cover fields: plan, record and export the work.")]
    | Annotated[Run, tyro.conf.subcommand("run")]
    | Annotated[Events, tyro.conf.subcommand("events")]
    | Annotated[Recover, tyro.conf.subcommand("recover")]
    | Annotated[Simulate, tyro.conf.subcommand("simulate")]
    | Annotated[Examples, tyro.conf.subcommand("examples")]
    | Annotated[ThresholdsVerb, tyro.conf.subcommand("thresholds")]
    | Annotated[Tune, tyro.conf.subcommand("tune")]
    | Annotated[Doctor, tyro.conf.subcommand("doctor")]
)


def keep_compiled() -> None:
    """Keep compiled programs from command to command, in ``$XDG_CACHE_HOME/lgprjax`` or ``~/.cache/lgprjax``.

    An optimisation only, and only before JAX is imported: existing environment variables are respected.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(root / "lgprjax" / "compiled"))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.1")


def main(arguments: Sequence[str] | None = None) -> None:
    """Entry point of the ``lgprjax`` command."""
    keep_compiled()
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:1] == ["import"]:
        words[1:] = recognised(words[1:])
    verb = tyro.cli(
        Verb,
        prog="lgprjax",
        description=_DESCRIPTION,
        args=words,
        config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )
    sys.exit(run_verb(verb.run))
