"""The commands of ``lgprjax``: purpose and two examples of each; reading and running a command."""

import dataclasses
import difflib
import functools
import operator
import os
import sys
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import lgprjax
from lgprjax.cli.calibrate import Calibrate
from lgprjax.cli.cover import CoverExport, CoverPlanVerb, CoverRecord
from lgprjax.cli.data import CheckVerb, Compare, Examples, Export, Recover
from lgprjax.cli.doctor import Doctor
from lgprjax.cli.events import Events
from lgprjax.cli.figures import STANDARD_OUTPUT, figures_alone
from lgprjax.cli.imports import (
    ImportCmu,
    ImportDt1,
    ImportDzt,
    ImportGprMax,
    ImportGrounded,
    ImportIprb,
    ImportLines,
    ImportMala,
    ImportMcap,
    ImportRosbag,
    ImportSegy,
    ImportSignals,
)
from lgprjax.cli.locate import Locate
from lgprjax.cli.maps import MapBuild, MapInfo, MapRefine, MapUpdate, MapVerify
from lgprjax.cli.options import check_words, current_names, nearest
from lgprjax.cli.radar import RadarLookup, RadarPlate
from lgprjax.cli.recognised import recognised, recording_suffixes, told_instead
from lgprjax.cli.register import Register
from lgprjax.cli.route import RouteExport, RouteList, RouteSelect
from lgprjax.cli.run import Run
from lgprjax.cli.simulate import Demo, Simulate
from lgprjax.cli.terminal import USAGE, Level, UsageError, detail, output_level, run_verb, show_every_character
from lgprjax.cli.tune import ThresholdsVerb, Tune, TuneCompare
from lgprjax.cli.view import View
from lgprjax.errors import refuse_own_input
from lgprjax.machine import keep_programs


class Verb(NamedTuple):
    """A command: its dataclass, its purpose in a few words, and examples without ``lgprjax``."""

    options: type
    what: str
    examples: tuple[str, ...]


class VerbGroup(NamedTuple):
    """Commands under one name; ``default`` is the one that is meant without a name of its own."""

    what: str
    text: str
    verbs: Mapping[str, Verb]
    examples: tuple[str, ...]
    default: str = ""


_IMPORT = VerbGroup(
    "convert other recordings to drive logs (X.drive.h5)",
    "Convert recordings of other instruments to drive logs. Without FORMAT, the file names determine the format.",
    {
        "dt1": Verb(
            ImportDt1,
            "Sensors & Software .DT1, with its .HD",
            ("import dt1 LINE01.DT1 -o line.drive.h5", "import dt1 LINE01.DT1 -o line.drive.h5 --length-m 48.5"),
        ),
        "dzt": Verb(
            ImportDzt,
            "GSSI .DZT",
            ("import dzt FILE.DZT -o line.drive.h5", "import dzt FILE.DZT -o line.drive.h5 --partial"),
        ),
        "mala": Verb(
            ImportMala,
            "MALA .rd3 or .rd7, with its .rad",
            ("import mala LINE.rd3 -o line.drive.h5", "import mala LINE.rd7 -o line.drive.h5 --time-zero header"),
        ),
        "iprb": Verb(
            ImportIprb,
            "ImpulseRadar .iprb, with its .iprh",
            ("import iprb LINE_001_A*.iprb -o X.drive.h5", "import iprb LINE_001_A01.iprb -o X.drive.h5 --length-m 30"),
        ),
        "segy": Verb(
            ImportSegy,
            "SEG-Y .sgy or .segy (extra segy)",
            ("import segy LINE.sgy --utm-zone 33N -o X.drive.h5", "import segy LINE.sgy -o X.drive.h5 --length-m 50"),
        ),
        "lines": Verb(
            ImportLines,
            "survey lines as one drive log",
            (
                "import lines XLINE*.DT1 --line-spacing-m 0.25 -o survey.drive.h5",
                "import lines A.DZT B.DZT --lines-at-m 0 0.4 -o survey.drive.h5",
            ),
        ),
        "grounded": Verb(
            ImportGrounded,
            "a run of the GROUNDED data set",
            (
                "import grounded run_0001 --utm-zone 19N --sample-interval-ns 0.16 --scan-rate-hz 126 -o X.drive.h5",
                "import grounded run_0002 --utm-zone 33N --sample-interval-ns 0.2 --scan-rate-hz 100 -o Y.drive.h5",
            ),
        ),
        "cmu": Verb(
            ImportCmu,
            "a sequence of the CMU-GPR data set",
            (
                "import cmu SEQUENCE_DIR --time-window-ns 40 -o X.drive.h5",
                "import cmu SEQUENCE_DIR --time-window-ns 40 --time-zero-ns 2.5 -o X.drive.h5",
            ),
        ),
        "gprmax": Verb(
            ImportGprMax,
            "gprMax .out or .h5",
            (
                "import gprmax model*.h5 -o X.drive.h5",
                "import gprmax merged.out --step-m 0.02 -o X.drive.h5",
            ),
        ),
        "mcap": Verb(
            ImportMcap,
            "ROS 2 messages in an MCAP file (extra log)",
            (
                "import mcap RECORDING.mcap -o X.drive.h5",
                "import mcap RECORDING.mcap -o X.drive.h5 --channel-pitch-m 0.127 --gnss-topic /gnss/fix",
            ),
        ),
        "rosbag": Verb(
            ImportRosbag,
            "ROS 1 .bag or ROS 2 .db3 (extra rosbag)",
            (
                "import rosbag RECORDING.bag -o X.drive.h5",
                "import rosbag BAG_FOLDER -o X.drive.h5 --radar-topic /gpr/scan",
            ),
        ),
        "signals": Verb(
            ImportSignals,
            "vehicle signals from .csv, .parquet or .mcap",
            (
                "import signals LOG.csv --columns COLUMNS.toml -o log.drive.h5",
                "import signals LOG.parquet --columns COLUMNS.toml -o log.drive.h5",
            ),
        ),
    },
    ("import XLINE*.DT1 -o survey.drive.h5", "import RECORDING.mcap -o X.drive.h5"),
)
_TUNE = VerbGroup(
    "fit a vehicle file to drive logs, compare vehicle files",
    "Fit vehicle files to drive logs, and compare them. lgprjax tune STUDY.toml is lgprjax tune study STUDY.toml.",
    {
        "study": Verb(
            Tune,
            "fit a vehicle file to drive logs",
            ("tune study tuning/k_ratio.toml -o out", "tune study STUDY.toml -o out --json -"),
        ),
        "compare": Verb(
            TuneCompare,
            "numbers, steering curves and drift of several vehicle files",
            (
                "tune compare onboard/made_up.vehicle.toml tuning/tuned.vehicle.toml -o fleet",
                "tune compare MARCH.vehicle.toml MAY.vehicle.toml -o drift --json -",
            ),
        ),
    },
    ("tune tuning/k_ratio.toml -o out", "tune compare A.vehicle.toml B.vehicle.toml -o fleet"),
    default="study",
)
_MAP = VerbGroup(
    "build, verify, refine and update maps of the ground",
    "Build and maintain maps of the ground (subsurface databases, M.map.h5).",
    {
        "build": Verb(
            MapBuild,
            "build a map from drive logs",
            (
                "map build left.drive.h5 right.drive.h5 -o road.map.h5",
                "map build survey.drive.h5 -o field.map.h5 --centre-frequency-mhz 300",
            ),
        ),
        "info": Verb(
            MapInfo,
            "show coverage and origin of a map",
            ("map info road.map.h5", "map info road.map.h5 --json -"),
        ),
        "verify": Verb(
            MapVerify,
            "find holes, weak or ambiguous ground, inconsistent baselines",
            ("map verify road.map.h5", "map verify road.map.h5 -o road-verified"),
        ),
        "refine": Verb(
            MapRefine,
            "align the baselines of a map with each other",
            ("map refine road.map.h5 -o better.map.h5", "map refine road.map.h5 -o better.map.h5 --json moved.json"),
        ),
        "update": Verb(
            MapUpdate,
            "add newer drives, retire changed ground",
            ("map update road.map.h5 new.drive.h5 -o newer.map.h5", "map update road.map.h5 new.drive.h5"),
        ),
    },
    ("map build X.drive.h5 -o road.map.h5", "map info road.map.h5"),
)
_ROUTE = VerbGroup(
    "list, select and export routes of a map",
    "List, select and export routes of a map.",
    {
        "list": Verb(
            RouteList,
            "list the routes of a map",
            ("route list road.map.h5", "route list road.map.h5 --json routes.json"),
        ),
        "select": Verb(
            RouteSelect,
            "write a route file: route or section, direction, speed",
            (
                "route select road.map.h5 baseline -o home.route.toml",
                "route select road.map.h5 baseline --from-m 20 --to-m 80 --cruise-mps 3 -o home.route.toml",
            ),
        ),
        "export": Verb(
            RouteExport,
            "write waypoints as CSV, GeoJSON or GPX",
            (
                "route export home.route.toml -o waypoints.gpx",
                "route export road.map.h5 baseline -o waypoints.geojson",
            ),
        ),
    },
    ("route list road.map.h5", "route select road.map.h5 baseline -o home.route.toml"),
)
_COVER = VerbGroup(
    "plan swaths over a field, record and export the area worked",
    "Area coverage: plan swaths over a field, record the area worked, export the record.",
    {
        "plan": Verb(
            CoverPlanVerb,
            "plan swaths over a field, in driving order",
            (
                "cover plan f.geojson --vehicle v.vehicle.toml -o f.cover.geojson",
                "cover plan f.cover.geojson --gaps f.worked.h5 --vehicle v.vehicle.toml -o g.cover.geojson",
            ),
        ),
        "record": Verb(
            CoverRecord,
            "compute the area worked from recorded runs",
            (
                "cover record RUN... --plan f.cover.geojson -o f.worked.h5",
                "cover record one two --plan f.cover.geojson gaps.cover.geojson -o all.worked.h5",
            ),
        ),
        "export": Verb(
            CoverExport,
            "export a record as GIS layers, CSV and report",
            (
                "cover export f.worked.h5 -o handover",
                'cover export f.worked.h5 -o handover --organisation "Made-up Works"',
            ),
        ),
    },
    (
        "cover plan f.geojson --vehicle v.vehicle.toml -o f.cover.geojson",
        "cover export f.worked.h5 -o handover",
    ),
)
_RADAR = VerbGroup(
    "calibrate a stepped-frequency radar: look-up, channels",
    "Calibrate a stepped-frequency radar from sweeps of the standing array: look-up, gain and delay of each channel.",
    {
        "lookup": Verb(
            RadarLookup,
            "look-up from sweeps into empty space",
            ("radar lookup RUN_FOLDER -o empty.radar.h5", "radar lookup X.drive.h5 Y.drive.h5 -o empty.radar.h5"),
        ),
        "plate": Verb(
            RadarPlate,
            "gain and delay of each channel over a metal plate",
            (
                "radar plate RUN_FOLDER --lookup empty.radar.h5 -o mine.radar.h5",
                "radar plate X.mcap --lookup empty.radar.h5 -o mine.radar.h5",
            ),
        ),
    },
    ("radar lookup EMPTY -o empty.radar.h5", "radar plate PLATE --lookup empty.radar.h5 -o mine.radar.h5"),
)

VERBS: Mapping[str, Mapping[str, Verb | VerbGroup]] = {
    "First steps": {
        "demo": Verb(
            Demo,
            "map a simulated road, locate a drive on it",
            ("demo", "demo -o out/demo"),
        ),
        "examples": Verb(
            Examples,
            "copy example sites, studies and configurations",
            ("examples", "examples -o my"),
        ),
        "doctor": Verb(
            Doctor,
            "check installation and machine",
            ("doctor", "doctor --onboard"),
        ),
    },
    "Recordings": {
        "import": _IMPORT,
        "view": Verb(
            View,
            "draw radargrams, survey plans, time slices",
            ("view LINE01.DT1", "view X.drive.h5 --html -o X.html"),
        ),
        "check": Verb(
            CheckVerb,
            "validate files, measure recording quality",
            ("check X.drive.h5 M.map.h5", "check X.drive.h5 --health"),
        ),
        "export": Verb(
            Export,
            "write ROS messages (MCAP, bags) or a trajectory",
            (
                "export X.drive.h5 --fixes result/X.fixes.h5 -o X.mcap",
                "export X.drive.h5 --fixes result/X.fixes.h5 -o X.tum",
            ),
        ),
    },
    "Maps and registration": {
        "map": _MAP,
        "register": Verb(
            Register,
            "locate drives on a map: fixes, pictures, report",
            (
                "register road.map.h5 Y.drive.h5 -o result",
                "register road.map.h5 A.drive.h5 B.drive.h5 -o result --workers 2",
            ),
        ),
        "locate": Verb(
            Locate,
            "find where drives begin on a map, without positions",
            (
                "locate road.map.h5 Y.drive.h5 -o result",
                "locate road.map.h5 Y.drive.h5 -o result --every-m 20",
            ),
        ),
        "compare": Verb(
            Compare,
            "compare two registrations of a drive",
            ("compare result other-result", "compare result/X.fixes.h5 other/X.fixes.h5 --json -"),
        ),
        "thresholds": Verb(
            ThresholdsVerb,
            "calibrate acceptance thresholds on your drives",
            (
                "thresholds road.map.h5 A.drive.h5 B.drive.h5 --window-m 4 -o own.thresholds.toml",
                "thresholds road.map.h5 A.drive.h5 --window-m 0 --risk 1e-5 -o single.thresholds.toml",
            ),
        ),
    },
    "On the vehicle": {
        "route": _ROUTE,
        "run": Verb(
            Run,
            "run the onboard runtime, on real or simulated devices",
            ("run onboard/simulated.run.toml --simulate", "run CONFIG.toml --preflight"),
        ),
        "events": Verb(
            Events,
            "list the events of a run with their causes",
            ("events RUN_FOLDER", "events RUN_FOLDER --json -"),
        ),
        "recover": Verb(
            Recover,
            "recover a drive log from an interrupted run",
            ("recover RUN_FOLDER -o X.drive.h5", "recover RUN_FOLDER -o X.drive.h5 --map moved/M.map.h5"),
        ),
        "cover": _COVER,
    },
    "Simulation and calibration": {
        "radar": _RADAR,
        "simulate": Verb(
            Simulate,
            "generate drive logs of a synthetic site or vehicle",
            ("simulate village -o drives", "simulate SITE.toml -o drives --only live"),
        ),
        "calibrate": Verb(
            Calibrate,
            "the numbers of a new vehicle, step by step with the kit",
            (
                "calibrate onboard/record.vehicle.toml --list",
                "calibrate onboard/record.vehicle.toml --simulate",
            ),
        ),
        "tune": _TUNE,
    },
}
"""Commands grouped by task, in the order of the help."""


def all_verbs() -> dict[str, Verb | VerbGroup]:
    """All commands and groups by name."""
    return {name: verb for part in VERBS.values() for name, verb in part.items()}


def every_verb() -> Iterator[tuple[str, Verb]]:
    """Commands by their full names, such as ``map build``."""
    for name, verb in all_verbs().items():
        if isinstance(verb, Verb):
            yield name, verb
        else:
            yield from ((f"{name} {part}", inner) for part, inner in verb.verbs.items())


_MEANT = {
    **dict.fromkeys(("localise", "localize", "match"), "register"),
    **dict.fromkeys(("convert", "read", "open"), "import"),
    **dict.fromkeys(("plot", "show", "draw"), "view"),
    **dict.fromkeys(("validate", "health"), "check"),
    **{words.split()[1]: words for words, _ in every_verb() if " " in words and words.split()[1] not in all_verbs()},
    **dict.fromkeys(("fit",), "tune"),
}
"""Names that other programs use, and the command for the same task."""


def keep_compiled() -> None:
    """Cache compiled programs between commands, in ``$XDG_CACHE_HOME/lgprjax`` or ``~/.cache/lgprjax``.

    An optimisation only, and only before JAX is imported: existing environment variables are respected.
    """
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    keep_programs(root / "lgprjax" / "compiled")
    # On a full disk the cache cannot be written; the next command compiles again.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache entry")


def run_command(arguments: Sequence[str]) -> int:
    """Read a command, without ``lgprjax``, and run it. Returns the exit status."""
    words, levels = _without_levels([str(word) for word in arguments])
    show_every_character()
    if len(levels) > 1:
        print("lgprjax: --quiet and --verbose: expected only one of them, found both (see --help)", file=sys.stderr)
        return USAGE
    with output_level(levels.pop() if levels else Level.NORMAL):
        return _run_words(words)


_LEVELS = {"-q": Level.QUIET, "--quiet": Level.QUIET, "-v": Level.VERBOSE, "--verbose": Level.VERBOSE}


def _without_levels(words: Sequence[str]) -> tuple[list[str], set[Level]]:
    """The words of a command without ``-q`` and ``-v``, and the levels that they set."""
    return [word for word in words if word not in _LEVELS], {_LEVELS[word] for word in words if word in _LEVELS}


def _run_words(words: list[str]) -> int:
    # The configuration of a run names a folder of its own.
    if words[:1] != ["run"]:
        keep_compiled()
    if words[:1] == ["import"]:
        words[1:] = recognised(words[1:])
    words = _with_default(words)
    if words[:1] == ["--version"]:
        print(f"lgprjax {lgprjax.__version__}")
        return 0
    if words[:1] == ["--completion"]:
        return run_verb(lambda: _print_completion(words[1:]), command="lgprjax")
    return run_verb(lambda: _run(words), command=" ".join(["lgprjax", *_named(words)]))


def _with_default(words: list[str]) -> list[str]:
    """The words, with a group's default command inserted after its name."""
    verb = all_verbs().get(words[0]) if words else None
    if (
        not isinstance(verb, VerbGroup)
        or not verb.default
        or len(words) == 1
        or words[1] in {*verb.verbs, "-h", "--help"}
    ):
        return words
    return [words[0], verb.default, *words[1:]]


def _named(words: Sequence[str]) -> list[str]:
    """The words that name a command, or a group of commands."""
    verb = all_verbs().get(words[0]) if words else None
    if isinstance(verb, VerbGroup) and len(words) > 1 and words[1] in verb.verbs:
        return list(words[:2])
    return [] if verb is None else [words[0]]


def _run(words: list[str]) -> int:
    from lgprjax.cli.help import group_help, top_help, verb_help

    name, known = _named(words), all_verbs()
    rest = words[len(name) :]
    wants_help = any(word in ("-h", "--help") for word in rest)
    if not name:
        if not wants_help:
            if not words:
                print(top_help(), end="", file=sys.stderr)
                return 2
            raise UsageError(f"{words[0]}: no such command{_meant(words[0], list(known))}")
        print(top_help(), end="")
        return 0
    verb = known[name[0]]
    if isinstance(verb, VerbGroup):
        if len(name) == 1:
            if rest and not wants_help:
                _refuse_group(name[0], verb, rest[0])
            print(group_help(name[0], verb), end="", file=sys.stdout if wants_help else sys.stderr)
            return 0 if wants_help else 2
        verb = verb.verbs[name[1]]
    if wants_help:
        print(verb_help(" ".join(name), verb), end="")
        return 0
    rest, notes = current_names(" ".join(name), rest)
    for note in notes:
        print(f"lgprjax: {note}", file=sys.stderr)
    check_words(verb.options, rest, {each: one.options for each, one in every_verb()})
    return _parse_and_run([*name, *rest])


def _meant(word: str, known: Sequence[str]) -> str:
    """A question that suggests a command for an unknown word; empty if none is similar."""
    if recognised([word]) != [word]:
        return f"; did you mean import {word}?"
    near = difflib.get_close_matches(word.lower(), [*known, *_MEANT], n=1, cutoff=0.6)
    return f"; did you mean {_MEANT.get(near[0], near[0])}?" if near else ""


def _refuse_group(name: str, group: VerbGroup, word: str) -> None:
    if name == "import":
        instead, recordings = told_instead(word), f"a recording ({recording_suffixes()})"
        if instead:
            raise UsageError(f"{word}: expected {recordings}; found {instead}")
        expected = f"a format ({', '.join(group.verbs)}), or {recordings}"
        if Path(word).is_file():
            expected += "; for other formats see docs/own_radar.md"
        raise UsageError(f"{word}: expected {expected}{nearest(word, list(group.verbs))}")
    raise UsageError(f"{word}: expected one of {', '.join(group.verbs)}{nearest(word, list(group.verbs))}")


_OUTPUTS = ("output", "json", "picture")


def _refuse_own_input(verb: Any) -> None:
    """Raise ``InputError`` if an output is also an input: ``--force`` replaces older outputs only."""
    if not dataclasses.is_dataclass(verb):
        return
    given = {field.name: getattr(verb, field.name) for field in dataclasses.fields(verb)}
    if isinstance(verb, MapUpdate):
        # It replaces its map.
        del given["output"]
    inputs = [
        path
        for name, value in given.items()
        if name not in _OUTPUTS
        for path in (value if isinstance(value, tuple | list) else (value,))
        if isinstance(path, Path)
    ]
    for output in (given.get(name) for name in _OUTPUTS):
        if isinstance(output, Path):
            refuse_own_input(output, inputs)


def _parse_and_run(words: Sequence[str]) -> int:
    verb = parsed(words)
    _refuse_own_input(verb)
    began_s = time.perf_counter()
    with figures_alone() if getattr(verb, "json", None) == STANDARD_OUTPUT else nullcontext():
        status = verb.run() or 0
        detail(f"total: {time.perf_counter() - began_s:.1f} s")
    return int(status)


def parsed(words: Sequence[str]) -> Any:
    """The command's dataclass with the values of the words."""
    import tyro

    def one_of(verbs: Mapping[str, Verb | VerbGroup]) -> Any:
        kinds = (
            Annotated[
                verb.options if isinstance(verb, Verb) else one_of(verb.verbs),
                tyro.conf.subcommand(name, description=verb.what),
            ]
            for name, verb in verbs.items()
        )
        return functools.reduce(operator.or_, kinds)

    return tyro.cli(
        one_of(all_verbs()),
        prog="lgprjax",
        args=list(words),
        config=(tyro.conf.OmitSubcommandPrefixes, tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff),
    )


_SHELLS = ("bash", "zsh", "fish", "tcsh")


def _print_completion(words: list[str]) -> int:
    if len(words) != 1 or words[0] not in _SHELLS:
        found = " ".join(words) or "nothing"
        raise UsageError(f"--completion: expected one of {', '.join(_SHELLS)}, found {found}")
    with suppress(SystemExit):  # when it has printed
        parsed(["--tyro-write-completion", words[0], "-"])
    return 0
