"""The rooms of the package: arrows between them go one way, and numeric rooms know no files, ports or pictures."""

import ast
import re
import subprocess
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

_PACKAGE = Path(__file__).parents[1] / "lgprjax"
_NUMERIC = ("autopilot", "coverage", "navigation", "pso", "radar", "registration", "scene", "subsurface", "vehicle")
# What only the host may do, by the module that does it.
_OF_THE_HOST = {"h5py", "matplotlib", "pandas", "serial", "socket", "subprocess", "tomllib", "time", "datetime"}


@cache
def _imports() -> dict[str, set[str]]:
    """Modules that the files of each room import, at whatever depth; not those for types only."""
    found: dict[str, set[str]] = {}
    for path in _PACKAGE.rglob("*.py"):
        parts = path.relative_to(_PACKAGE).parts
        room = parts[0] if len(parts) > 1 else path.stem
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for_types = {
            inner
            for node in ast.walk(tree)
            if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
            for inner in ast.walk(node)
        }
        for node in ast.walk(tree):
            if node in for_types:
                continue
            if isinstance(node, ast.ImportFrom) and node.module:
                found.setdefault(room, set()).add(node.module)
            elif isinstance(node, ast.Import):
                found.setdefault(room, set()).update(name.name for name in node.names)
    return found


def _arrows() -> dict[str, set[str]]:
    return {
        room: {name.split(".")[1] for name in names if name.startswith("lgprjax.")} - {room}
        for room, names in _imports().items()
    }


def test_no_way_leads_from_a_room_back_to_it() -> None:
    arrows = _arrows()
    assert arrows["registration"] >= {"pso", "radar"}
    for room in arrows:
        reached, ahead = set[str](), set(arrows[room])
        while ahead:
            reached |= ahead
            ahead = {far for near in ahead for far in arrows.get(near, set())} - reached
        assert room not in reached


def test_no_module_imports_itself_by_a_detour() -> None:
    """At whatever depth, types as well; the root's own names alone, such as the version, are for all."""
    names = {".".join(path.relative_to(_PACKAGE.parent).with_suffix("").parts): path for path in _PACKAGE.rglob("*.py")}
    modules = {name.removesuffix(".__init__"): path for name, path in names.items()}
    graph: dict[str, set[str]] = {}
    for name, path in modules.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        found = {
            within if (within := f"{node.module}.{part.name}") in modules else node.module
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.module
            for part in node.names
        }
        graph[name] = (found & modules.keys()) - {name, "lgprjax"}
    assert graph["lgprjax.registration"] > {"lgprjax.registration.search"}
    TopologicalSorter(graph).prepare()


def test_a_numeric_room_knows_nothing_of_the_host() -> None:
    for room in _NUMERIC:
        outside = {name.split(".")[0] for name in _imports()[room]}
        assert not outside & _OF_THE_HOST, room
        assert _arrows()[room] <= {*_NUMERIC, "errors", "frames", "machine"}, room


def test_what_drives_is_stepped_in_one_place() -> None:
    """Simulation and vehicle both call ``step_onboard`` and ``step_skid``: nothing else wires their parts.

    What predicts the sigma of a planned field (``worked.predicted``), and what smooths a recorded run
    (``runtime.smoothed``), run the filter alone, and drive nothing.
    """
    parts = ("step_navigator(", "step_skid_filter(", "limit_command(")
    users = {
        path.relative_to(_PACKAGE).parts[0]
        for path in _PACKAGE.rglob("*.py")
        if any(part in path.read_text(encoding="utf-8") for part in parts)
        and path.name not in ("predicted.py", "smoothed.py")
    }
    assert users == {"autopilot", "navigation"}


def test_the_command_line_calls_and_is_not_called() -> None:
    assert [room for room, names in _arrows().items() if "cli" in names] == ["__main__"]
    assert not [room for room, names in _arrows().items() if "api" in names and room != "__init__"]


def test_no_process_waits_for_what_few_of_its_commands_need() -> None:
    """Half a second each: every command, and every process on board, would start so much later."""
    slow = ("scipy.signal", "scipy.stats", "matplotlib", "xarray")
    modules = (
        "lgprjax.formats",
        "lgprjax.batch",
        "lgprjax.runtime.registration.program",
        "lgprjax.runtime.control.program",
    )
    code = f"import sys, {', '.join(modules)}; print(*[name for name in {slow} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


def test_a_record_of_many_fields_is_built_by_their_names() -> None:
    """More than six values in a row are swapped without a notice; an unpacked sequence has an order of its own."""
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in _PACKAGE.rglob("*.py")}
    fields: dict[str, set[int]] = {}
    for tree in trees.values():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and not any(
                isinstance(inner, ast.FunctionDef) and inner.name == "__init__" for inner in node.body
            ):
                fields.setdefault(node.name, set()).add(sum(isinstance(inner, ast.AnnAssign) for inner in node.body))
    many = {name for name, counts in fields.items() if min(counts) > 6}
    assert {"LiveScans", "VehicleStatus"} <= many
    for path, tree in trees.items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in many:
                unpacked = any(isinstance(value, ast.Starred) for value in node.args)
                assert unpacked or not node.args, f"{path}:{node.lineno}"


def test_the_walks_through_the_code_name_what_is_there() -> None:
    """Each row names files of the package, and after each file functions or classes of it."""
    text = (_PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    walks = text[text.index("| question | answer |") : text.index("## Packages and dependencies")]
    named: dict[str, list[str]] = {}
    path = ""
    for word in re.findall(r"`([\w/.]+)`", walks):
        if word.startswith("lgprjax/"):
            path = word
        elif path and word.isidentifier() and word not in ("p_false", "_judge"):
            named.setdefault(path, []).append(word)
    assert len(named) >= 20
    for path, names in named.items():
        tree = ast.parse((_PACKAGE.parent / path).read_text(encoding="utf-8"))
        there = {node.name for node in tree.body if isinstance(node, ast.ClassDef | ast.FunctionDef)}
        there |= {
            node.target.id
            for node in tree.body
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
        }
        there |= {
            name.id
            for node in tree.body
            if isinstance(node, ast.Assign)
            for name in node.targets
            if isinstance(name, ast.Name)
        }
        assert set(names) <= there, path
