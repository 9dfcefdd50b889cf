"""Is what lgprjax needs installed, in the versions it asks for, and whole?"""

from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from typing import Literal

from packaging.requirements import Requirement

import lgprjax

_EXTRA_FOR = {
    "batch": "register --scheduler",
    "bench": "the peers of lgprjax bench",
    "docs": "make docs",
    "gis": "cover export to GeoPackage",
    "lint": "make lint, make types",
    "log": "import mcap, export",
    "notebook": "notebooks/",
    "onboard": "lgprjax run",
    "segy": "import segy",
    "test": "make test",
}
_FOR_DEVELOPERS = {"docs", "lint", "test"}


@dataclass(frozen=True)
class Finding:
    """Something that was looked at.

    Attributes:
        name: of it.
        found: in words.
        verdict: absent: not installed, and nothing is wrong with that; bad: lgprjax cannot be relied on.
        advice: what to do; empty where nothing needs to be done.
    """

    name: str
    found: str
    verdict: Literal["good", "absent", "look", "bad"]
    advice: str = ""


def look_at_packages() -> list[Finding]:
    """lgprjax itself, the packages it needs, and those of its extras."""
    try:
        required = [Requirement(line) for line in metadata.requires("lgprjax") or ()]
        own = Finding("lgprjax", metadata.version("lgprjax"), "good")
    except metadata.PackageNotFoundError:
        advice = "it runs from a source tree; install it: make demo, or pip install ."
        return [Finding("lgprjax", f"{lgprjax.__version__}, not installed", "look", advice), *_data()]
    core = [requirement for requirement in required if requirement.marker is None]
    findings = [own, *(_core(requirement) for requirement in core)]
    extras = sorted(metadata.metadata("lgprjax").get_all("Provides-Extra") or ())
    for extra in extras:
        of_it = [r for r in required if r.marker is not None and r.marker.evaluate({"extra": extra})]
        if extra not in _FOR_DEVELOPERS:
            findings.append(_extra(extra, of_it))
    return [*findings, *_data()]


def _core(requirement: Requirement) -> Finding:
    found = _version(requirement.name)
    advice = f'pip install "{requirement.name}{requirement.specifier}"'
    if found is None:
        return Finding(requirement.name, "missing", "bad", advice)
    if not requirement.specifier.contains(found, prereleases=True):
        return Finding(requirement.name, f"{found}, asked for {requirement.specifier}", "bad", advice)
    return Finding(requirement.name, found, "good")


def _extra(extra: str, requirements: list[Requirement]) -> Finding:
    """An extra is there, absent, or half there."""
    name, serves = f"[{extra}]", _EXTRA_FOR.get(extra, "")
    advice = f'pip install "lgprjax[{extra}]" ({serves})' if serves else f'pip install "lgprjax[{extra}]"'
    versions = {requirement.name: _version(requirement.name) for requirement in requirements}
    there = {package: found for package, found in versions.items() if found is not None}
    wrong = [
        f"{requirement.name} {there[requirement.name]}, asked for {requirement.specifier}"
        for requirement in requirements
        if requirement.name in there and not requirement.specifier.contains(there[requirement.name], prereleases=True)
    ]
    if wrong:
        return Finding(name, "; ".join(wrong), "look", advice)
    if len(there) == len(versions):
        return Finding(name, ", ".join(f"{package} {found}" for package, found in there.items()), "good")
    missing = ", ".join(package for package in versions if package not in there)
    # Others bring some of these packages too: what is half there is as good as absent.
    return Finding(name, f"missing: {missing}", "absent", advice)


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _data() -> list[Finding]:
    """The formats as data, without which no file can be read."""
    from lgprjax.formats.schema import load_schema

    names = ("drive", "map", "fixes", "route", "vehicle")
    try:
        versions = ", ".join(f"{name} {load_schema(name).version}" for name in names)
    except (OSError, ValueError, KeyError) as error:
        return [Finding("data_schema", str(error), "bad", "pip install --force-reinstall lgprjax")]
    packaged = Path(str(resources.files("lgprjax"))) / "data_schema"
    where = "of the package" if packaged.is_dir() else "of the source tree"
    return [Finding("data_schema", f"{versions} ({where})", "good")]
