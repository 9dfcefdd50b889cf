"""What the site shows beside docs/: the reference, the messages, the notebooks as they are kept, the file formats as
tables, and the files that pages link to."""

import ast
import re
import tomllib
from collections.abc import Iterator
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter

from benchmarks.page import record_pages
from lgprjax.autopilot.monitors import FINDINGS
from lgprjax.runtime.control.skid.watches import SKID_FINDINGS
from validation.worlds.table import markdown_of, read_figures

_ROOT = Path(__file__).parent
_ROOMS = (
    *(
        "formats",
        "recordings",
        "batch",
        "mapping",
        "worked",
        "registration",
        "subsurface",
        "radar",
        "pso",
        "navigation",
    ),
    *("coverage", "autopilot", "vehicle", "tuning", "scene", "simulation", "runtime.config", "report"),
    *("config", "wire", "run_records", "frames", "errors"),
)
# A link that leaves docs/, with the heading that it may name.
_OUTSIDE = re.compile(r"\]\(\.\./([^)#\s]+)(?:#[^)]*)?\)")
# A record, which has a page on the site.
_RECORD = re.compile(r"\]\((records/[\w-]+)\.json\)")
# Of a notebook's outputs: a page within the page, and what pandas says about the looks of its tables.
_FRAME = re.compile(r'<iframe srcdoc="(.*?)" title="(.*?)"[^>]*></iframe>', re.DOTALL)
_LOOKS = re.compile(r'<style scoped>.*?</style>\s*| border="1" class="dataframe"', re.DOTALL)
_CELL = re.compile(r"<td>(.*?)</td>", re.DOTALL)
_PICTURE = re.compile(r'(<img [^>]*src="([^"]+)"[^>]*>)')
_REFUSALS = ("InputError", "ArgumentError", "NotExcitedError")
_COMMANDS, _PUBLIC = "reference/commands.md", "reference/public_names.md"
_WRITTEN_BY = {"lgprjax/cli/verbs.py": _COMMANDS, "lgprjax/api/page.py": _PUBLIC}
"""Sources that pages link to, and their generated pages on the site."""
# What Markdown would read in a cell.
_LITERAL = re.compile(r"[&<>{}\[\]*_|`\\]")
_TABLES = {
    "attribute": "Attributes",
    "group": "Groups",
    "dataset": "Datasets",
    "column": "Columns",
    "key": "Keys",
}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the generated pages into the navigation: the reference below the written pages, records into Evidence."""
    python = [{f"lgprjax.{room}": f"reference/{room}.md"} for room in _ROOMS]
    formats = [{path.name: f"files/{path.stem}.md"} for path in _schemas()]
    generated = [{"Commands": _COMMANDS}, {"Public Python names": _PUBLIC}, {"Python modules": python}]
    sections = {name: inside for entry in config.nav or [] for name, inside in entry.items()}
    sections["Reference"] += [*generated, {"Files": formats}, {"Messages": "messages.md"}]
    sections["Reference"].append({"Findings and reactions": "findings.md"})
    sections["Evidence"].append({"Records": [f"records/{name}" for name in _record_pages()]})
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
    files.append(File.generated(config, "messages.md", content=messages_page()))
    files.append(File.generated(config, "findings.md", content=findings_page()))
    for name, page in reference_pages():
        files.append(File.generated(config, name, content=page))
    for name, page in _record_pages().items():
        files.append(File.generated(config, f"records/{name}", content=page))
    files.append(File.generated(config, "repository/CHANGELOG.md", content=(_ROOT / "CHANGELOG.md").read_text("utf-8")))
    for file in _notebook_files(config):
        files.append(file)
    for path in sorted(linked):
        if _place(path).startswith("repository/"):
            files.append(File.generated(config, _place(path), content=(_ROOT / path).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Point links that leave docs/ at the places that these files have on the site."""
    if page.file.src_uri.startswith(("records/", "reference/")):
        return markdown
    up = "../" * page.file.src_uri.count("/")
    markdown = _RECORD.sub(r"](\1.md)", markdown)
    return _OUTSIDE.sub(lambda link: f"]({up}{_place(link[1])})", markdown)


def _notebook_files(config: MkDocsConfig) -> Iterator[File]:
    """The notebooks' list and their pages, with what belongs to these. No cell is run."""
    folder = _ROOT / "notebooks"
    contents = (folder / "README.md").read_text("utf-8").replace(".ipynb)", ".md)")
    yield File.generated(config, "notebooks/README.md", content=contents)
    for path in sorted(folder.glob("*.ipynb")):
        for name, content in _notebook_page(path):
            yield File.generated(config, f"notebooks/{name}", content=content)
        for kept in (path, path.with_suffix(".py")):
            yield File.generated(config, f"notebooks/{kept.name}", content=kept.read_bytes())


def _notebook_page(path: Path) -> Iterator[tuple[str, str | bytes]]:
    """Names and contents of a notebook's page, its pictures, and the interactive pages among its outputs."""
    book = nbformat.read(path, as_version=4)
    beside = f"{path.stem}_files"
    pages: list[str] = []

    def in_file(frame: re.Match[str]) -> str:
        pages.append(unescape(frame[1]))
        source = f"{beside}/page_{len(pages)}.html"
        opened = f'<p><a href="{source}">Open this picture on a page of its own</a></p>'
        return f'<iframe src="{source}" title="{frame[2]}" loading="lazy"></iframe>\n{opened}'

    for cell in book.cells:
        for output in cell.get("outputs", ()):
            shown = output.get("data", {})
            if "text/html" in shown:
                shown["text/html"] = _FRAME.sub(in_file, _LOOKS.sub("", shown["text/html"]))
    exporter = MarkdownExporter(preprocessors=["nbconvert.preprocessors.CoalesceStreamsPreprocessor"])
    markdown, found = exporter.from_notebook_node(book, {"unique_key": path.stem, "output_files_dir": beside})
    title, text = markdown.strip().split("\n", 1)
    files = f"*Kept outputs of [{path.name}]({path.name}); the same as a script: [{path.stem}.py]({path.stem}.py).*"
    text = text.replace("![png](", "![Drawn by the cell above](")
    # Without the column of contents, code of 120 characters fits.
    yield f"{path.stem}.md", f"---\nhide: [toc]\n---\n{title}\n\n{files}\n{text}\n"
    yield from found["outputs"].items()
    yield from ((f"{beside}/page_{number}.html", page) for number, page in enumerate(pages, 1))


def on_post_template(output_content: str, template_name: str, **_: object) -> str:
    """Addresses on the page of what is not found: beside it, as the site need not stand at the root of its host."""
    return re.sub('"/(?!>)', '"./', output_content) if template_name == "404.html" else output_content


def on_page_content(html: str, page: Page, **_: object) -> str:
    """For telephones: pictures that open by themselves, to be enlarged, and room for the sentences of wide tables."""
    html = _PICTURE.sub(r'<a href="\2">\1</a>', html)
    html = _CELL.sub(lambda cell: cell[0].replace("<td", '<td class="long"', 1) if _is_long(cell[1]) else cell[0], html)
    return f'<div class="notebook">{html}</div>' if page.file.src_uri.startswith("notebooks/") else html


def _is_long(cell: str) -> bool:
    return len(re.sub("<[^>]*>", "", cell)) > 60


def _schemas() -> list[Path]:
    return sorted((_ROOT / "data_schema").glob("*.toml"))


def reference_pages() -> Iterator[tuple[str, str]]:
    """File names and contents of the references that the package writes: commands, and public Python names."""
    from lgprjax.api.page import api_page
    from lgprjax.cli.help import reference_page

    yield _COMMANDS, reference_page()
    yield _PUBLIC, api_page()


def _place(path: str) -> str:
    """Where a file of the repository is on the site; a page of its own links would not hold there."""
    if path.startswith("data_schema/") and path.endswith(".toml"):
        return f"files/{Path(path).stem}.md"
    if path.startswith("notebooks/"):
        return path.replace(".ipynb", ".md")
    if path in _WRITTEN_BY:
        return _WRITTEN_BY[path]
    return f"repository/{path.removesuffix('.md')}{'.txt' if path.endswith('.md') else ''}"


def messages_page() -> str:
    """Every refusal that the package words, a row each: to be read, and improved where it stands."""
    told = "A command prints `FILE: PLACE: expected EXPECTED, found FOUND`. A name in braces stands for its value."
    lines = ["# Messages", "", told, "", "| where | place | expected | found |", "| --- | --- | --- | --- |"]
    for path in sorted((_ROOT / "lgprjax").rglob("*.py")):
        calls = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.Call)]
        for call in sorted(calls, key=lambda call: (call.lineno, call.col_offset)):
            if isinstance(call.func, ast.Name) and call.func.id in _REFUSALS and len(call.args) >= 3:
                cells = (f"{path.relative_to(_ROOT)}:{call.lineno}", *map(_worded, call.args[-3:]))
                shown = (_LITERAL.sub(lambda sign: f"&#{ord(sign[0])};", " ".join(each.split())) for each in cells)
                lines.append("| " + " | ".join(shown) + " |")
    return "\n".join([*lines, ""])


def findings_page() -> str:
    """Findings of the monitors and the reaction to each, from the tables that the vehicle uses."""
    about = "Findings of the vehicle's monitors, as the page shows them. Reactions hold while the computer drives."
    lines = [
        "# Findings and reactions",
        "",
        about,
        "",
        "| finding | reaction | refuses engaging |",
        "| --- | --- | --- |",
    ]
    for finding in (*FINDINGS.values(), *SKID_FINDINGS.values()):
        refuses = "yes" if finding.refuses else "no"
        lines.append(f"| {finding.text} | {finding.severity.name.capitalize()} | {refuses} |")
    return "\n".join([*lines, ""])


def _worded(value: ast.expr) -> str:
    """A text as its reader finds it; in braces the expression of what is only known when it is raised."""
    if isinstance(value, ast.JoinedStr):
        return "".join(map(_worded, value.values))
    if isinstance(value, ast.BinOp) and isinstance(value.op, ast.Add):
        return _worded(value.left) + _worded(value.right)
    if isinstance(value, ast.IfExp):
        return f"{_worded(value.body)} / {_worded(value.orelse)}"
    if isinstance(value, ast.Constant):
        return str(value.value) or "(nothing)"
    return f"{{{ast.unparse(value.value if isinstance(value, ast.FormattedValue) else value)}}}"


@cache
def _record_pages() -> dict[str, str]:
    """Pages of docs/records by file name, the overview first."""
    folder = _ROOT / "docs" / "records"
    return record_pages(folder, {"worlds": markdown_of(read_figures(folder / "worlds.json"))})


def _format_page(path: Path) -> str:
    """A file format as tables, and the file that says it."""
    text = path.read_text("utf-8")
    schema = tomllib.loads(text)
    lines = [f"# {path.name}", "", f"{schema.get('description', schema['schema'])}. Version {schema['version']}."]
    for key, title in _TABLES.items():
        entries = [each for each in schema.get(key, ()) if "path" in each]
        if entries:
            lines += ["", f"## {title}", "", *_table(("name", "what it is", "type", "axes", "unit", "rules"), entries)]
    return "\n".join([*lines, "", "## The file itself", "", "```toml", text.rstrip(), "```", ""])


def _table(titles: tuple[str, ...], entries: list[dict[str, Any]]) -> list[str]:
    """Entries of a schema as lines of a table, without the columns that are empty."""
    rows = [_row(entry) for entry in entries]
    kept = [place for place in range(len(titles)) if any(row[place] for row in rows)]
    table = [[titles[place] for place in kept], ["---"] * len(kept), *([row[place] for place in kept] for row in rows)]
    return ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in table]


def _row(entry: dict[str, Any]) -> tuple[str, ...]:
    rules = [*entry.get("checks", ()), *([] if entry.get("required", True) else ["may be absent"])]
    if "range" in entry:
        rules.append("{} to {}".format(*entry["range"]))
    return (
        f"`{entry['path']}`",
        entry.get("description", ""),
        ", ".join(entry.get("dtype", ())),
        ", ".join(map(str, entry.get("dims", ()))),
        entry.get("unit", ""),
        ", ".join(rules),
    )
