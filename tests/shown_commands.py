"""The commands that the pages show, in blocks and in the running text, and the blocks that are run as they stand."""

import re
import shlex
from pathlib import Path

from canon.commands import shell, succeed

ROOT = Path(__file__).parents[1]
# Pages whose marked blocks are run in their order, by tests/test_docs.py; the tutorial shows nothing else.
TUTORIAL = ROOT / "docs" / "tutorial.md"
HOW_TO = tuple(ROOT / "docs" / f"{name}.md" for name in ("own_radar", "own_vehicle", "from_ros2"))
PAGES = sorted(
    path
    for path in [*(ROOT / "docs").glob("*.md"), *ROOT.glob("*.md"), *ROOT.glob("[a-z]*/README.md")]
    if path.name not in ("tutorial.md", "CHANGELOG.md")
)
# What stands for a number, a name or several names in a command, and what the parser may read there.
_STANDS_FOR = {"T": "60", "N": "2", "$study": "look_ahead"}
# `lgprjax register --track` in running text is about an option; what it is given to goes without saying.
_WITHOUT_SAYING = {"register": ["M.map.h5", "D.drive.h5", "-o", "R"]}
_BLOCK = re.compile(r"(?:^```sh\n(?:.*?)^```)|(?:^(?: {4}.*\n)+)", re.MULTILINE | re.DOTALL)
_SHOWN = re.compile(r"^\s*(lgprjax .*)$", re.MULTILINE)
_INLINE = re.compile(r"`(lgprjax [a-z][^`|]*)`")
_MARKED = re.compile(r"^<!-- run -->\n```(sh|python)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_BENCHMARK = re.compile(r"`(python -m benchmarks [a-z][^`]*)`")


def benchmarks_shown(page: Path) -> list[str]:
    """Benchmarks of a page's running text."""
    return [re.sub(r"\s+", " ", found) for found in _BENCHMARK.findall(page.read_text(encoding="utf-8"))]


def _plain(line: str) -> str:
    return re.split(r"\s{2,}#", line)[0].strip()


def _commands(blocks: list[str]) -> list[str]:
    lines = [line for block in blocks for line in _SHOWN.findall(block.replace("\\\n", " "))]
    return [re.sub(r"\s+", " ", _plain(line)) for line in lines]


def shown_in_blocks(page: Path) -> list[str]:
    """Commands of a page's blocks, a line each."""
    return _commands(_BLOCK.findall(page.read_text(encoding="utf-8")))


def marked_blocks(page: Path) -> list[tuple[str, str]]:
    """Language, sh or python, and text of each block that is to be run."""
    return _MARKED.findall(page.read_text(encoding="utf-8"))


def run_as_it_stands(page: Path) -> list[str]:
    """Commands of the blocks that are run."""
    return _commands([text for language, text in marked_blocks(page) if language == "sh"])


def python_of(page: Path) -> list[str]:
    """Every block of Python."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def follow(language: str, text: str) -> None:
    """Run a block in the present folder; every command must succeed."""
    if language == "python":
        exec(text, {})
    else:
        for words in shell(text):
            succeed(*words)


def shown_in_text(page: Path) -> list[str]:
    """Commands, and verbs that are only named, of a page's running text."""
    return [re.sub(r"\s+", " ", found) for found in _INLINE.findall(page.read_text(encoding="utf-8"))]


def words_of(command: str) -> list[str]:
    """Arguments of a command, without the program's name; what stands for something else is filled in."""
    words = [word.removesuffix("...") or "V.vehicle.toml" for word in shlex.split(command)[1:]]
    if words[1:2] and words[1].startswith("--"):
        words += _WITHOUT_SAYING.get(words[0], [])
    for short, full in _STANDS_FOR.items():
        words = [full if word == short else word.replace(short, full) if "$" in short else word for word in words]
    return words


def names_a_verb_only(command: str) -> bool:
    """Whether a command is no more than the name of a verb, as `lgprjax map build`."""
    return all(re.fullmatch(r"[a-z-]+", word) and not word.startswith("-") for word in shlex.split(command)[1:])
