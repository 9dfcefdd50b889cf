"""Checksums of the files that pictures are drawn from, and the record of them beside the pictures."""

import ast
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "docs" / "pictures"
RECORD = FOLDER / "sources.json"


def sources_sha256(patterns: Sequence[str]) -> str:
    """One checksum over all files that the patterns name. Docstrings and comments of Python files do not count.

    Raises:
        FileNotFoundError: a pattern names no file.
    """
    whole = hashlib.sha256()
    for pattern in sorted(set(patterns)):
        files = sorted(path for path in ROOT.glob(pattern) if path.is_file() and path.suffix != ".pyc")
        if not files:
            raise FileNotFoundError(f"no file is named {pattern}")
        for path in files:
            whole.update(path.relative_to(ROOT).as_posix().encode())
            whole.update(hashlib.sha256(_content(path)).digest())
    return whole.hexdigest()


def _content(path: Path) -> bytes:
    if path.suffix != ".py":
        return path.read_bytes()
    return "\n".join(_statements(path.read_text(encoding="utf-8"))).encode()


def _statements(text: str) -> Iterable[str]:
    """Lines of a module without docstrings, lines of comment and empty lines."""
    texts: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        # A string on its own documents what it follows or begins.
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            texts.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    for number, line in enumerate(text.splitlines(), start=1):
        if number not in texts and line.strip() and not line.lstrip().startswith("#"):
            yield line.rstrip()


def read_record() -> dict[str, dict[str, object]]:
    """What the pictures were drawn from: patterns and checksum by name."""
    if not RECORD.exists():
        return {}
    found: dict[str, dict[str, object]] = json.loads(RECORD.read_text(encoding="utf-8"))
    return found


def write_record(drawn: Mapping[str, tuple[Sequence[str], str]]) -> None:
    """Note patterns and checksum of pictures that were drawn just now; the other entries stay."""
    record = read_record()
    for name, (patterns, sha256) in drawn.items():
        record[name] = {"files": sorted(set(patterns)), "sha256": sha256}
    RECORD.write_text(json.dumps(dict(sorted(record.items())), indent=1) + "\n", encoding="utf-8")


def stale(pictures: Mapping[str, Sequence[str]]) -> list[str]:
    """Pictures that are missing, or whose sources have changed since they were drawn."""
    record, sums, found = read_record(), {}, []
    for name, patterns in pictures.items():
        key = tuple(sorted(set(patterns)))
        if key not in sums:
            sums[key] = sources_sha256(patterns)
        if not (FOLDER / name).exists() or record.get(name, {}).get("sha256") != sums[key]:
            found.append(name)
    return found
