"""Runs validations, each a folder of tests, takes up interrupted ones, and writes their records."""

import argparse
import hashlib
import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from benchmarks.records import machine_line

ROOT = Path(__file__).resolve().parents[1]
STATE = ROOT / "build" / "validation"
RECORDS = ROOT / "docs" / "records" / "validation"
RUNTIME_TYPES = "runtime_types"
LONG = "long"
_NOTHING_RAN = 5
"""Exit status of pytest."""
# What runs a hundred times a tick and has no arrays is left out.
TYPED = (
    *("api.matching", "autopilot", "batch", "coverage", "formats", "frames", "mapping", "navigation", "pso", "radar"),
    *("registration", "report", "scene", "simulation.field_loop", "simulation.loop", "recordings", "subsurface"),
    *("tuning", "vehicle", "worked"),
)


class Validation(NamedTuple):
    """One validation.

    Attributes:
        about: one line for people.
        minutes: estimate on two idle cores with compiled programs cached, until a complete record says it.
        needs: environment variable without which its tests skip.
    """

    about: str
    minutes: int
    needs: str = ""


VALIDATIONS = {
    "benchmarks": Validation("every benchmark starts and ends, on few repetitions", 30),
    "damage": Validation("mutated recordings, messages and requests are read correctly or refused", 26),
    "drives": Validation("many and large drives: days, map updates, refinement, clusters, killed workers", 230),
    "fields": Validation("random fields, worked-area claims under other laws, killed and resumed field runs", 300),
    "filters": Validation("consistency of navigation filters, smoothers and the pose graph over many drives", 6),
    "first_day": Validation("three vehicles on a mile: recorded, calibrated, driven by RTK and by LGPR in snow", 120),
    "full_wave": Validation("generated echoes and lines against gprMax", 20, "LGPRJAX_GPRMAX"),
    LONG: Validation("tests marked long, of which the suite runs shorter ones of the same kind", 3),
    "loops": Validation("closed loops, faults on board and killed recorders in full length", 500),
    "notebooks": Validation("every notebook runs from a fresh clone", 15),
    RUNTIME_TYPES: Validation("the test suite with shapes and types of arguments checked at run time", 40),
    "surveys": Validation("every real recording is imported and registered", 15, "LGPRJAX_REAL_DATA"),
    "vehicles": Validation("identification and look-ahead of hidden vehicles, also by radar fixes; intervals", 205),
    "worlds": Validation("thirty independent worlds on their days, full-wave lines, impostors", 240),
}


def source_hash() -> str:
    """Digest of the package and of all tests: a change of any makes every result out of date."""
    digest = hashlib.sha256()
    for folder in ("lgprjax", "benchmarks", "tests", "validation", "data_schema"):
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in (".py", ".toml", ".json", ".csv"):
                digest.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def results_in(state: Path, source: str) -> dict[str, dict[str, object]]:
    """Last result of each test with this source, by node identifier."""
    found: dict[str, dict[str, object]] = {}
    for line in state.read_text(encoding="utf-8").splitlines() if state.exists() else []:
        # The line that was being written when a run was killed is cut.
        with suppress(json.JSONDecodeError):
            row = json.loads(line)
            if row["source"] == source:
                found[row["test"]] = row
    return found


def minutes_of(name: str) -> float:
    """Minutes of a validation: those of its last complete record, else the estimate."""
    path = RECORDS / f"{name}.json"
    record = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"complete": False}
    return float(record["minutes"]) if record["complete"] else VALIDATIONS[name].minutes


def run(name: str, source: str, extra: list[str]) -> bool:
    """Run one validation and write its record; whether all of its tests passed."""
    state = STATE / f"{name}.jsonl"
    STATE.mkdir(parents=True, exist_ok=True)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"LGPRJAX_VALIDATION": str(state), "LGPRJAX_VALIDATION_SOURCE": source}
    paths = [str(ROOT / "validation" / name)]
    if name == RUNTIME_TYPES:
        checked = ",".join(f"lgprjax.{room}" for room in TYPED)
        paths = [str(ROOT / "tests"), "-m=long or not long", f"--jaxtyping-packages={checked},beartype.beartype"]
    elif name == LONG:
        paths = [str(ROOT / "tests"), "-m=long"]
    begun = time.time()
    # The command of pytest leaves the source tree out of the path: what is validated is the installed package.
    command = [str(Path(sys.executable).parent / "pytest"), *paths, "-s", *extra]
    status = subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode
    results = list(results_in(state, source).values())
    # No test is left where all have passed already.
    passed = status == 0 or (status == _NOTHING_RAN and any(row["outcome"] == "passed" for row in results))
    if not extra:
        _write_record(name, results, begun, passed)
    return passed


def _write_record(name: str, rows: list[dict[str, object]], begun: float, complete: bool) -> None:
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    ).stdout.strip()
    record = {
        "command": f"make validation NAME={name}",
        "date": time.strftime("%Y-%m-%d", time.gmtime(begun)),
        "commit": commit,
        "machine": machine_line(),
        "complete": complete,
        "minutes": round(sum(float(str(row["seconds"])) for row in rows) / 60.0, 1),
        "tests": [
            {key: row[key] for key in ("test", "outcome", "seconds", "figures")}
            for row in sorted(rows, key=lambda row: str(row["test"]))
        ],
    }
    RECORDS.mkdir(parents=True, exist_ok=True)
    path = RECORDS / f"{name}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    part.replace(path)


def main() -> int:
    """Read the command line and run; the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m validation",
        description="Run validations; all of them without a name. Tests that passed with this source are not repeated.",
        epilog="Arguments after -- go to pytest (-k NAME selects tests; no record is written then).",
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"one of: {', '.join(VALIDATIONS)}")
    parser.add_argument("--list", action="store_true", help="print what there is, and how long it takes")
    parser.add_argument("--again", action="store_true", help="repeat tests that passed")
    words = sys.argv[1:]
    cut = words.index("--") if "--" in words else len(words)
    options = parser.parse_args(words[:cut])
    unknown = sorted(set(options.names) - VALIDATIONS.keys())
    if unknown:
        parser.error(f"unknown validation: {', '.join(unknown)} (choose from {', '.join(VALIDATIONS)})")
    names = options.names or list(VALIDATIONS)
    source = source_hash()
    for name in names:
        about = VALIDATIONS[name]
        passed = sum(row["outcome"] == "passed" for row in results_in(STATE / f"{name}.jsonl", source).values())
        done = f"; {passed} tests passed already" if passed and not options.again else ""
        missing = f"; skips without {about.needs}" if about.needs and about.needs not in os.environ else ""
        print(f"{name:14} about {minutes_of(name):4.0f} min  {about.about}{done}{missing}")
    print(f"{'total':14} about {sum(map(minutes_of, names)):4.0f} min", flush=True)
    if options.list:
        return 0
    if options.again:
        for name in names:
            (STATE / f"{name}.jsonl").unlink(missing_ok=True)
    failed = [name for name in names if not run(name, source, words[cut + 1 :])]
    print("failed: " + ", ".join(failed) if failed else "all passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
