"""Options that messages of the package name, and the verbs that can print them: by reading the package's source.

A verb prints what is written in its own class and in whatever that refers to: functions, constants, and methods of
classes that it refers to, where some of that code calls a method of this name.
"""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from lgprjax.cli.options import options_of
from lgprjax.cli.verbs import every_verb

_ROOT = Path(__file__).parents[1]
VERBS = dict(every_verb())
ACCEPTED = {
    name: {each for option in options_of(verb.options) for each in option.names} | {"--help", "--quiet", "--verbose"}
    for name, verb in VERBS.items()
}
_GROUPS = {name.split()[0] for name in VERBS if " " in name}
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]*[a-z0-9](?![\w=-])")
# A verb that a message names: after the program's name, or two words that only verbs have, or the first word of a
# command, or the word before the option.
_TWO_WORDS = "|".join(name for name in VERBS if " " in name)
_ONE_WORD = "|".join(name for name in VERBS if " " not in name)
_NAMED = re.compile(
    rf"lgprjax ({_TWO_WORDS}|[a-z]+)(?=\W)|\b({_TWO_WORDS})(?=\s)|^({_ONE_WORD})(?=\s)|\b({_ONE_WORD})(?= $)"
)
_OTHERS_PROGRAM = re.compile(r"\b(?:pip|ros2|rosbag|mcap|python)\b[^;:]*$")
Key = tuple[str, str]


def unknown_options(text: str, verb: str) -> list[str]:
    """Options in a text that neither the verb named before them nor, where none is, the given verb accepts."""
    wrong = []
    for found in _OPTION.finditer(text):
        before = text[: found.start()]
        named = ["".join(each) for each in _NAMED.findall(before)]
        meant = named[-1] if named else verb
        verbs = [name for name in VERBS if name == meant or (meant in _GROUPS and name.startswith(f"{meant} "))]
        if not any(found[0] in ACCEPTED[name] for name in verbs) and not _OTHERS_PROGRAM.search(before):
            wrong.append(found[0])
    return wrong


class Message(NamedTuple):
    """A text of the package, where it stands, and a verb that can print it."""

    module: str
    name: str
    text: str
    verb: str


def messages() -> Iterator[Message]:
    """Texts with options, once for each verb that can print them."""
    for verb, described in VERBS.items():
        for key in sorted(_reached((described.options.__module__, described.options.__name__))):
            for text in _texts(key):
                yield Message(*key, text, verb)


@cache
def _sources() -> tuple[dict[Key, Key], dict[Key, ast.AST]]:
    """Where each name of a module is defined, and the code of each function, method, class body and constant."""
    names: dict[Key, Key] = {}
    code: dict[Key, ast.AST] = {}
    for path in sorted((_ROOT / "lgprjax").rglob("*.py")):
        module = ".".join(path.relative_to(_ROOT).with_suffix("").parts).removesuffix(".__init__")
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("lgprjax"):
                names |= {(module, each.asname or each.name): (node.module or "", each.name) for each in node.names}
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                methods = [each for each in node.body if isinstance(each, ast.FunctionDef)]
                code |= {(module, f"{node.name}.{each.name}"): each for each in methods}
                body = [each for each in node.body if not isinstance(each, ast.FunctionDef)]
                bases = [ast.Expr(each) for each in node.bases]
                code[module, node.name] = ast.Module([*bases, *body], [])
            elif isinstance(node, ast.FunctionDef):
                code[module, node.name] = node
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                code |= {(module, each.id): node for t in targets for each in ast.walk(t) if isinstance(each, ast.Name)}
    return names, code


def _defined(key: Key) -> Key | None:
    names, code = _sources()
    for _ in range(9):  # through packages that give on what their modules define
        if key in code:
            return key
        if key not in names:
            return None
        key = names[key]
    return None


@cache
def _uses(key: Key) -> tuple[frozenset[Key], frozenset[str]]:
    """What a piece of code refers to, and names of attributes in it."""
    nodes = list(ast.walk(_sources()[1][key]))
    used = (_defined((key[0], node.id)) for node in nodes if isinstance(node, ast.Name))
    attributes = frozenset(node.attr for node in nodes if isinstance(node, ast.Attribute))
    return frozenset(each for each in used if each is not None), attributes


def _reached(verb: Key) -> set[Key]:
    code = _sources()[1]
    seen, called, size = {verb}, {"run"}, 0
    while size != len(seen) + len(called):
        size = len(seen) + len(called)
        for key in list(seen):
            used, attributes = _uses(key)
            seen |= used
            called |= attributes
        for module, name in code:
            owner, _, method = name.partition(".")
            if method and (module, owner) in seen and (method in called or method.startswith("__")):
                seen.add((module, name))
    return seen


@cache
def _texts(key: Key) -> tuple[str, ...]:
    """Texts with options in a piece of code, but documentation, and single words, which are arguments of programs."""
    node = _sources()[1][key]
    said, skipped = [], set()
    for each in ast.walk(node):
        if isinstance(each, ast.JoinedStr):
            said.append("".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in each.values))
            skipped |= {id(part) for part in each.values}
        elif isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant):
            skipped.add(id(each.value))
    for each in ast.walk(node):
        if isinstance(each, ast.Constant) and isinstance(each.value, str) and id(each) not in skipped:
            said.append(each.value)
    return tuple(text for text in said if " " in text.strip() and _OPTION.search(text) and "color-scheme" not in text)
