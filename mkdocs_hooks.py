"""What the site shows beside docs/: the reference, the file formats as tables, and the files that pages link to."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_ROOT = Path(__file__).parent
_ROOMS = (
    *("formats", "batch", "mapping", "studies", "worked", "registration", "subsurface", "radar", "pso", "navigation"),
    *("coverage", "autopilot", "vehicle", "tuning", "scene", "simulation", "runtime.config", "report"),
    *("config", "wire", "run_records", "frames", "errors"),
)
# A link that leaves docs/, with the heading that it may name.
_OUTSIDE = re.compile(r"\]\(\.\./([^)#\s]+)(?:#[^)]*)?\)")
_TABLES = {
    "attribute": "Attributes",
    "group": "Groups",
    "dataset": "Datasets",
    "column": "Columns",
    "key": "Keys",
}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the reference into the navigation, before the performance."""
    python = [{f"lgprjax.{room}": f"reference/{room}.md"} for room in _ROOMS]
    formats = [{path.name: f"files/{path.stem}.md"} for path in _schemas()]
    assert config.nav is not None
    before = next(place for place, each in enumerate(config.nav) if "Performance" in each)
    config.nav.insert(before, {"Reference": [{"Python": python}, {"Files": formats}]})
    config.nav.insert(before + 2, {"Performance, all records": "all_records.md"})
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages and files that are made of the repository."""
    linked: set[str] = set()
    for file in files.documentation_pages():
        linked |= set(_OUTSIDE.findall(file.content_string))
    for room in _ROOMS:
        page = f"# lgprjax.{room}\n\n::: lgprjax.{room}\n"
        files.append(File.generated(config, f"reference/{room}.md", content=page))
    for schema in _schemas():
        files.append(File.generated(config, f"files/{schema.stem}.md", content=_format_page(schema)))
    files.append(File.generated(config, "all_records.md", content=_records_page()))
    files.append(File.generated(config, "repository/CHANGELOG.md", content=(_ROOT / "CHANGELOG.md").read_text("utf-8")))
    for path in sorted(linked):
        if _place(path).startswith("repository/"):
            files.append(File.generated(config, _place(path), content=(_ROOT / path).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links that leave docs/ at the places that these files have on the site."""
    up = "../" * page.file.src_uri.count("/")
    return _OUTSIDE.sub(lambda link: f"]({up}{_place(link[1])})", markdown)


def _schemas() -> list[Path]:
    return sorted((_ROOT / "data_schema").glob("*.toml"))


def _place(path: str) -> str:
    """Where a file of the repository is on the site; a page of its own links would not hold there."""
    if path.startswith("data_schema/") and path.endswith(".toml"):
        return f"files/{Path(path).stem}.md"
    return f"repository/{path.removesuffix('.md')}{'.txt' if path.endswith('.md') else ''}"


def _records_page() -> str:
    """Figures and goals as the benchmarks wrote them, a table a benchmark; nobody has typed them."""
    lines = ["# All records", "", "What benchmarks wrote themselves (`--json`), as it is. [What was measured]"]
    lines[-1] += "(performance.md) says what was measured and what of it may be concluded."
    for path in sorted((_ROOT / "docs" / "records").glob("*.json")):
        told = json.loads(path.read_text("utf-8"))
        quick = " --quick" if told["quick"] else ""
        command = told.get("command", f"python -m benchmarks {path.stem}")
        lines += ["", f"## {command}{quick}", "", told["machine"], ""]
        lines += ["| figure | value | unit | goal | met | |", "| --- " * 6 + "|"]
        lines += [_record_row(record) for record in told["records"]]
    return "\n".join([*lines, ""])


def _record_row(record: dict[str, Any]) -> str:
    value = "not measured" if record["value"] is None else f"{record['value']:.4g}"
    sign = "≤" if record["direction"] == "lower" else "≥"
    goal = "" if record["goal"] is None else f"{sign} {record['goal']:g}"
    met = {None: "", True: "yes", False: "**no**"}[record["met"]]
    cells = (record["key"], value, record["unit"], goal, met, record["note"])
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _format_page(path: Path) -> str:
    """A file format as tables, and the file that says it."""
    text = path.read_text("utf-8")
    schema = tomllib.loads(text)
    lines = [f"# {path.name}", "", f"{schema.get('description', schema['schema'])}. Version {schema['version']}."]
    for key, title in _TABLES.items():
        entries = [each for each in schema.get(key, ()) if "path" in each]
        if entries:
            lines += ["", f"## {title}", "", "| name | type | axes | unit | | what it is |", "| --- " * 6 + "|"]
            lines += [_row(entry) for entry in entries]
    return "\n".join([*lines, "", "## The file itself", "", "```toml", text.rstrip(), "```", ""])


def _row(entry: dict[str, Any]) -> str:
    rules = [*entry.get("checks", ()), *([] if entry.get("required", True) else ["may be absent"])]
    if "range" in entry:
        rules.append("{} to {}".format(*entry["range"]))
    cells = (
        f"`{entry['path']}`",
        ", ".join(entry.get("dtype", ())),
        ", ".join(map(str, entry.get("dims", ()))),
        entry.get("unit", ""),
        ", ".join(rules),
        entry.get("description", ""),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
