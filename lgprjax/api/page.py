"""Reference of the public names for the site, from docstrings and signatures: ``python -m lgprjax.api.page``."""

import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from enum import Enum
from types import ModuleType

import lgprjax

_SECTION = re.compile(r"(Args|Attributes|Returns|Raises|Example):")
_ENTRY = re.compile(r"(?P<name>\w[\w, ]*): (?P<text>.*)", re.DOTALL)
_HEAD = """# Public Python names

[Python interface](../api.md) has a short session and a table of these names. The tests run every example in a folder
with the drives of `lx.simulate("village", "drives/")`, their map `site.map.h5`, a recorded run in `field/`, and the
files of `onboard/` and `tuning/`.

```python
import lgprjax as lx
```

Every file argument accepts a path, as a string or a `Path`, or an object opened from the file. Bad input raises
`lgprjax.errors.InputError`, a `ValueError` with file, place, expected and found. Functions that draw return matplotlib
axes; the argument `ax` sets the axes to draw on.
"""
_EXAMPLES = {
    "RegisterOptions": (
        'options = lx.RegisterOptions(search_m=3.0, risk=1e-5)\nwith lx.open_map("site.map.h5") as site:\n'
        '    batch = site.batch("drives/live.drive.h5", slice(0, 100, 50), options=options)'
    ),
    "Fix": (
        'with lx.open_map("site.map.h5") as site:\n'
        '    fix = lx.match(site.batch("drives/live.drive.h5", slice(200, 700, 100)))\n'
        "assert isinstance(fix, lx.Fix)\n"
        "located = fix.pose[fix.code == lx.Code.OK]  # east_m, north_m, height_m, yaw_rad, roll_rad"
    ),
    "run_swarm": """import jax
import jax.numpy as jnp

keys = jax.random.split(jax.random.key(0), 2)
start = jax.random.uniform(keys[0], (32, 2), minval=-1.0, maxval=1.0)
config = lx.SwarmConfig(particles=32, iterations=40)


def highest(key, height):              # maximum of a hill around (0.25, 0.25)
    def hill(places):
        return height * jnp.exp(-jnp.sum((places - 0.25) ** 2, axis=1))

    return lx.run_swarm(key, start, hill, jnp.ones(2, bool), config=config)


found = jax.jit(highest)(keys[1], 2.0)
print(found.position, found.score)     # near [0.25 0.25], 2
many = jax.vmap(highest, in_axes=(0, None))(jax.random.split(keys[1], 8), 2.0)
slope = jax.grad(lambda height: highest(keys[1], height).score)(2.0)""",
    "SwarmConfig": (
        "options = lx.RegisterOptions(swarm=lx.SwarmConfig(particles=24, iterations=16))\n"
        "print(options.swarm)                   # swarm of register(..., options=options)"
    ),
    "Code": 'assert lx.Code.OK == 0\nassert lx.Code(3).label == "edge"',
}
"""Examples of names without an example in their docstrings; their packages do not read files."""


def api_page() -> str:
    """The page as Markdown."""
    parts = [_HEAD]
    described = set[type]()
    # All names are loaded first: a function may return a class of another module.
    for name, public in [(name, getattr(lgprjax, name)) for name in lgprjax.__all__]:
        parts += [f"## {name}\n", _code(_signature(name, public)), _body(inspect.getdoc(public) or "")]
        if isinstance(public, type) and issubclass(public, Enum):
            parts.append("".join(f"- `{each.name}` = {each.value}\n" for each in public))
        if name in _EXAMPLES:
            parts.append(_code(_EXAMPLES[name]))
        ahead = [] if isinstance(public, type) else _given(public)
        while ahead:
            given = ahead.pop(0)
            if given in described:
                continue
            described.add(given)
            parts += [f"### {given.__name__}\n", _body(inspect.getdoc(given) or ""), *_members(given)]
            ahead += [each for method in vars(given).values() if inspect.isfunction(method) for each in _given(method)]
    return "\n".join(part.rstrip("\n") + "\n" for part in parts)


def summaries() -> Iterator[tuple[str, str]]:
    """Each public name with the first sentence of its docstring."""
    for name in lgprjax.__all__:
        first = _plain((inspect.getdoc(getattr(lgprjax, name)) or "").split("\n\n")[0])
        yield name, re.split(r"(?<=\.)\s", _joined(first))[0]


def examples() -> Iterator[tuple[str, str]]:
    """Each public name with its example."""
    for name in lgprjax.__all__:
        doc = inspect.getdoc(getattr(lgprjax, name)) or ""
        told = dict(_sections(doc)).get("Example")
        yield name, _EXAMPLES.get(name, "") if told is None else told


def _given(public: object) -> list[type]:
    """The class of this package that a function returns, unless the class is a public name."""
    annotation = inspect.signature(public).return_annotation  # type: ignore[arg-type]
    if isinstance(annotation, str):
        annotation = next((found for each in _api() if (found := getattr(each, annotation, None))), None)
    if not isinstance(annotation, type) or annotation.__name__ in lgprjax.__all__:
        return []
    return [annotation] if annotation.__module__.startswith("lgprjax.") else []


def _api() -> list[ModuleType]:
    """Loaded modules of the public interface."""
    return [module for name, module in sorted(sys.modules.items()) if name.startswith("lgprjax.api.")]


def _signature(name: str, public: object) -> str:
    if isinstance(public, type) and issubclass(public, Enum):
        return f"class {name}"
    parameters = inspect.signature(public).parameters.values()  # type: ignore[arg-type]
    told, starred = list[str](), False
    for each in parameters:
        if each.name == "self":
            continue
        if each.kind is each.KEYWORD_ONLY and not starred:
            told, starred = [*told, "*"], True
        several = each.kind is each.VAR_POSITIONAL
        stars = "*" if several else "**" if each.kind is each.VAR_KEYWORD else ""
        starred |= several
        told.append(stars + each.name if each.default is each.empty else f"{each.name}={each.default!r}")
    inside = ", ".join(told)
    if len(inside) + len(name) > 100:
        inside = "\n" + textwrap.indent(",\n".join(told), "    ") + ",\n"
    return f"{name}({inside})"


def _members(public: type) -> list[str]:
    """Public methods and properties of the class, without inherited ones."""
    parts = []
    for name, member in vars(public).items():
        plain = getattr(member, "fget", None) or getattr(member, "func", None) or member
        if name.startswith("_") or not inspect.isfunction(plain) or not plain.__doc__:
            continue
        shown = _signature(name, member) if inspect.isfunction(member) else name
        parts.append(f"#### `.{' '.join(shown.split())}`\n\n{_body(inspect.getdoc(plain) or '')}")
    return parts


def _sections(doc: str) -> Iterator[tuple[str, str]]:
    """Title and text of each section of a docstring; the first section has no title."""
    title, held = "", list[str]()
    for line in doc.splitlines():
        begun = _SECTION.fullmatch(line)
        if begun:
            yield title, textwrap.dedent("\n".join(held)).strip("\n")
            title, held = begun[1], []
        else:
            held.append(line)
    yield title, textwrap.dedent("\n".join(held)).strip("\n")


def _body(doc: str) -> str:
    parts = []
    for title, text in _sections(doc):
        if not title:
            parts.append(_plain(text) + "\n")
        elif title == "Example":
            parts.append(_code(text))
        elif title == "Returns":
            parts.append(f"Returns: {_plain(_joined(text))}\n")
        else:
            parts.append(f"{title}:\n\n" + "".join(f"- {entry}\n" for entry in _entries(text)))
    return "\n".join(parts)


def _entries(text: str) -> Iterator[str]:
    """Entries ``name: text`` of a section, each in one line."""
    for block in re.split(r"\n(?=\S)", text):
        told = _ENTRY.fullmatch(_joined(block))
        if told is None:
            yield _plain(_joined(block))
        else:
            names = ", ".join(f"`{name}`" for name in told["name"].split(", "))
            yield f"{names}: {_plain(told['text'])}"


def _joined(text: str) -> str:
    return " ".join(text.split())


def _plain(text: str) -> str:
    return text.replace("``", "`")


def _code(text: str) -> str:
    return f"```python\n{text}\n```\n"


if __name__ == "__main__":
    sys.stdout.write(api_page())
