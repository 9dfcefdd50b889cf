"""Pages made from ``docs/records``: one page for each record, an overview, and the table of ``docs/performance.md``.

``python -m benchmarks.page`` writes the targets into ``docs/performance.md``; ``mkdocs_hooks.py`` adds the pages.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.records import Record, markdown_table, read_records

_PLACE = re.compile(r"(<!-- targets -->\n).*?(<!-- end -->)", re.DOTALL)
_MISSING = "not recorded"


class About(NamedTuple):
    """Title of a record's page, and one sentence on the measurement."""

    title: str
    text: str


ABOUT = {
    "archive": About("Many drives", "A thousand short drives, registered by one and by several worker processes."),
    "closed-loop": About(
        "Closed loop off road",
        "Simulated vehicle on generated miles. Every scan is rendered, registered and fused; the autopilot drives.",
    ),
    "drive": About("Time of a whole drive", "A simulated drive of eleven channels, registered from end to end."),
    "full-wave": About(
        "Lines by Maxwell's equations",
        "Lines of one antenna over simulated ground, computed by a two-dimensional finite-difference solver.",
    ),
    "gpu_drive": About("A drive on a GPU", "One drive, registered on one NVIDIA H200 and on two processor cores."),
    "gpu_registration": About("Registration on a GPU", "Many scans on one NVIDIA H200 and on two processor cores."),
    "gpu_rollouts": About("Rollouts on a GPU", "Many vehicles on one NVIDIA H200 and on two processor cores."),
    "real": About("Real survey lines", "Recordings of commercial radars, imported and registered by default."),
    "registration": About(
        "Pose search against other searches", "Generated ground with decoys; other programs solve the same problems."
    ),
    "rollouts": About("Vehicle rollouts against other programs", "65,536 different vehicles on one course."),
    "tuning": About("A tuning study", "Look-ahead from twenty simulated logs, against SciPy and NumPy."),
    "worlds": About(
        "Held-out synthetic sites",
        "Ground, radars, days and drives of a generator that shares no code with lgprjax. Defaults only.",
    ),
    "wrong-logs": About(
        "Overconfident attitude errors", "Height, heading, roll or odometer of synthetic logs are wrong on purpose."
    ),
}
_NOTES = {
    "closed-loop": "Each row is the worst of five courses for engaged, speed, tracking and steering, and the mean of "
    "five for the rest. Wrong fixes are the sum. NEES: mean normalized squared error of the position.",
    "full-wave": "Scans after the first 4 m. Errors are along the track. An impostor is other ground.",
    "real": "Errors are against the labels of the survey. *Right*: no farther off than the labels are good for.",
    "worlds": "Scans after the first 4 m on the map. *Wrong*: `ok`, and more than 0.3 m off. Worlds marked * have map "
    "lines farther apart than half a wavelength. A bold NEES is outside its 99.9 % interval.",
    "wrong-logs": "Rows name the world, the windows, and the error added to height, heading and roll, or the factor on "
    "the odometer. *Outside*: height, heading or roll off by more than four sigma.",
}


def record_pages(folder: Path, tables: Mapping[str, str] | None = None) -> dict[str, str]:
    """Markdown pages by file name: ``index.md``, and one for each record of a folder.

    Args:
        folder: of the records.
        tables: further tables by a record's name, shown above its figures.
    """
    paths = sorted(folder.glob("*.json"))
    pages = {path.with_suffix(".md").name: _page(path, (tables or {}).get(path.stem, "")) for path in paths}
    lines = [
        *("# Records of measurements", ""),
        "Measuring programs write these files with `--json`. [Performance](../performance.md) and",
        *("[Accuracy](../accuracy.md) summarize them.", ""),
        "| record | command | date | commit | targets met | targets missed |",
        "| --- " * 6 + "|",
    ]
    for path in paths:
        told, records = read_records(path)
        met, missed = (sum(record.met is one for record in records) for one in (True, False))
        cells = (_code(told.get("command")), told.get("date", _MISSING), told.get("commit", _MISSING), str(met))
        lines.append(_line((f"[{about(path.stem).title}]({path.stem}.md)", *cells, _bold(str(missed), missed > 0))))
    return {"index.md": "\n".join([*lines, ""]), **pages}


def about(name: str) -> About:
    """Title and sentence of a record; of one without a description its name."""
    return ABOUT.get(name, About(name.replace("_", " ").replace("-", " ").capitalize(), ""))


def filled_page(page: str, folder: Path) -> str:
    """A page with the table of targets between ``<!-- targets -->`` and ``<!-- end -->``."""
    return _PLACE.sub(lambda place: f"{place[1]}\n{targets_table(folder)}\n{place[2]}", page)


def targets_table(folder: Path) -> str:
    """A row for each record with targets: how many are met, and each kind that is missed, bold."""
    lines = ["| record | targets met | missed |", "| --- | --- | --- |"]
    for path in sorted(folder.glob("*.json")):
        records = [record for record in read_records(path)[1] if record.goal is not None]
        if records:
            met = f"{sum(record.met is True for record in records)} of {len(records)}"
            missed = "; ".join(f"**{each}**" for each in _missed(records))
            lines.append(_line((f"[{about(path.stem).title}](records/{path.name})", met, missed or "none")))
    return "\n".join([*lines, ""])


def _missed(records: Sequence[Record]) -> Iterator[str]:
    """Missed targets in words; those of one figure in many conditions together."""
    for figure, of_figure in _by_figure(records).items():
        missed = [record for record in of_figure if record.met is False]
        if len(missed) == 1:
            yield f"{missed[0].key}: {_value(missed[0])} ({_goal(missed[0])})"
        elif missed:
            worst = (min if missed[0].direction == "higher" else max)(missed, key=lambda record: record.value)
            yield f"{figure}: {len(missed)} of {len(of_figure)}, worst {_value(worst)} ({_goal(worst)})"


def _page(path: Path, more: str) -> str:
    told, records = read_records(path)
    title, text = about(path.stem)
    command = told.get("command")
    facts = {
        "Command": _code(command) + (" (few repetitions: rough figures)" if told.get("quick") else ""),
        "Date": told.get("date", _MISSING),
        "Commit": told.get("commit", _MISSING),
        "Machine": told.get("machine", _MISSING),
        "Not measured": "; ".join(told.get("not_measured") or ()) or "–",
        "File": f"[{path.name}]({path.name})",
    }
    lines = [f"# {title}", "", *([text, ""] if text else []), *(f"- {name}: {fact}" for name, fact in facts.items())]
    lines += ["", "## Targets", "", *_targets(records)]
    if path.stem in _NOTES:
        lines += ["", _NOTES[path.stem]]
    if more:
        lines += ["", "## Summary", "", more.strip()]
    if all(": " in record.key for record in records):
        lines += ["", "## Figures by condition", "", condition_table(records)]
        shown = _conditions(records)
        records = [record for record in records if record.key.rpartition(": ")[0] not in shown]
    if records:
        lines += ["", "## Figures", "", markdown_table(records)]
    return "\n".join(lines).rstrip() + "\n"


def _targets(records: Sequence[Record]) -> list[str]:
    """Targets as lines of a table, a row for each figure and target; misses bold."""
    with_goal = [record for record in records if record.goal is not None]
    if not with_goal:
        return ["The record states no targets."]
    lines = [
        "Targets were set before the measurement. Missed ones are bold.",
        "",
        "| figure | target | met | worst |",
        "| --- | --- | --- | --- |",
    ]
    groups: dict[tuple[str, str], list[Record]] = {}
    for figure, of_figure in _by_figure(with_goal).items():
        for record in of_figure:
            groups.setdefault((figure, _goal(record)), []).append(record)
    for (figure, goal), group in groups.items():
        worst = (min if group[0].direction == "higher" else max)(group, key=lambda record: record.value)
        met, name = sum(record.met is True for record in group), figure
        if len(group) <= 3 and all(": " in record.key for record in group):
            name = f"{'; '.join(record.key.rpartition(': ')[0] for record in group)}: {figure}"
        cells = (f"{met} of {len(group)}", _value(worst))
        lines.append(_line((name, goal, *(_bold(cell, met < len(group)) for cell in cells))))
    return lines


def _by_figure(records: Sequence[Record]) -> dict[str, list[Record]]:
    """Records by the figure that ``CONDITION: FIGURE`` names, or by the whole key."""
    found: dict[str, list[Record]] = {}
    for record in records:
        found.setdefault(record.key.rpartition(": ")[2], []).append(record)
    return found


def _conditions(records: Sequence[Record]) -> set[str]:
    """Those that have the first record's figure."""
    first = records[0].key.rpartition(": ")[2]
    return {record.key.rpartition(": ")[0] for record in records if record.key.endswith(f": {first}")}


def condition_table(records: Sequence[Record]) -> str:
    """Records whose keys are ``CONDITION: FIGURE``, a row a condition; what misses its goal is bold.

    Conditions that lack the first record's figure are of another kind, and left out; what is no number is left empty.
    """
    cells: dict[str, dict[str, str]] = {}
    heads: dict[str, str] = {}
    shown = _conditions(records)
    for record in records:
        condition, _, figure = record.key.rpartition(": ")
        if condition not in shown:
            continue
        unit = f", {record.unit}" if record.unit else ""
        heads.setdefault(figure, f"{figure}{unit}")
        text = f"{record.value:.3g}" if abs(record.value) < 99.0 else f"{record.value:.1f}".removesuffix(".0")
        if record.value != record.value:
            text = ""
        cells.setdefault(condition, {})[figure] = _bold(text, record.met is False)
    rows = [["", *heads.values()], ["---"] * (1 + len(heads))]
    rows += [[condition, *(own.get(figure, "") for figure in heads)] for condition, own in cells.items()]
    return "".join("| " + " | ".join(row) + " |\n" for row in rows)


def _value(record: Record) -> str:
    if record.value != record.value:
        return "not measured"
    return f"{record.value:.4g} {record.unit}".rstrip()


def _goal(record: Record) -> str:
    return f"{'≥' if record.direction == 'higher' else '≤'} {record.goal:.4g} {record.unit}".rstrip()


def _bold(text: str, bold: bool) -> str:
    return f"**{text}**" if bold and text else text


def _code(command: Any) -> str:
    return f"`{command}`" if command else _MISSING


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


if __name__ == "__main__":
    page = Path(__file__).resolve().parents[1] / "docs" / "performance.md"
    page.write_text(filled_page(page.read_text(encoding="utf-8"), page.parent / "records"), encoding="utf-8")
