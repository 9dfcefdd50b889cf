"""The package as it is installed and as it is handed on: its data, its types, its command."""

import re
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

import lgprjax

_ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def installed() -> list[str]:
    """Files of the installed package."""
    try:
        files = metadata.files("lgprjax")
    except metadata.PackageNotFoundError:
        pytest.skip("lgprjax is not installed, it runs from the source tree")
    assert files is not None
    return [str(file) for file in files]


def test_formats_templates_and_types_are_installed(installed: list[str]) -> None:
    assert "lgprjax/py.typed" in installed
    for folder in ("data_schema", "onboard", "sites", "tuning"):
        place = f"lgprjax/{folder}/" if folder == "data_schema" else f"lgprjax/examples/{folder}/"
        of_source = {path.name for path in (_ROOT / folder).iterdir() if path.is_file()}
        assert of_source
        assert of_source <= {Path(name).name for name in installed if name.startswith(place)}
    page = {path.name for path in (_ROOT / "lgprjax" / "runtime" / "display" / "page").iterdir()}
    assert page <= {Path(name).name for name in installed}
    assert not [name for name in installed if name.startswith(("tests/", "docs/"))]


def test_one_version_is_told_everywhere() -> None:
    citation = (_ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.findall(r"^version: (.*)$", citation, re.MULTILINE) == [lgprjax.__version__]
    changes = re.findall(r"^## (\d+\.\d+\.\d+)", (_ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert changes[0] == lgprjax.__version__
    assert len(set(changes)) == len(changes)


def _build(kind: str, source: Path, target: Path) -> Path:
    """Have the project's own build program make a distribution, as pip does, in a process of its own."""
    call = f"import hatchling.build, sys; print(hatchling.build.build_{kind}(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", call, target], cwd=source, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    return target / done.stdout.splitlines()[-1]


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The source distribution, unpacked."""
    folder = tmp_path_factory.mktemp("source")
    with tarfile.open(_build("sdist", _ROOT, folder)) as packed:
        packed.extractall(folder, filter="data")
    return folder / f"lgprjax-{lgprjax.__version__}"


@pytest.fixture(scope="module")
def wheel(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that is built from the source distribution."""
    return _build("wheel", source, tmp_path_factory.mktemp("wheel"))


def _files(folder: Path) -> set[str]:
    return {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*")
        if path.is_file()
        and not any(part == "__pycache__" or part.startswith(".") for part in path.relative_to(folder).parts)
    }


def test_the_source_distribution_holds_all_that_it_is_told_to(source: Path) -> None:
    told = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name in told["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]:
        assert (source / name).exists(), name
        if (_ROOT / name).is_dir():
            assert _files(source / name) == _files(_ROOT / name)
    present = {path.name for path in source.iterdir()}
    assert present & {"build", "dist", "out", ".venv", ".git", ".hypothesis", ".pytest_cache"} == set()


def test_the_wheel_of_the_source_distribution_holds_package_schemas_and_examples(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
        (metadata_of,) = (name for name in names if name.endswith(".dist-info/METADATA"))
        (commands,) = (name for name in names if name.endswith(".dist-info/entry_points.txt"))
        told, command = packed.read(metadata_of).decode(), packed.read(commands).decode()
    expected = {f"lgprjax/{name}" for name in _files(_ROOT / "lgprjax")}
    expected |= {f"lgprjax/data_schema/{name}" for name in _files(_ROOT / "data_schema")}
    for folder in ("onboard", "sites", "tuning"):
        expected |= {f"lgprjax/examples/{folder}/{name}" for name in _files(_ROOT / folder)}
    assert {name for name in names if ".dist-info/" not in name} == expected
    assert {"lgprjax/py.typed", "lgprjax/examples/sites/village.toml", "lgprjax/data_schema/drive.toml"} <= names
    assert {path.suffix for path in map(Path, names) if "/display/page/" in str(path)} >= {".html", ".js", ".css"}
    assert any(name.endswith(".dist-info/licenses/LICENSE") for name in names)
    assert f"Version: {lgprjax.__version__}\n" in told
    assert "License-Expression: Apache-2.0\n" in told
    assert "lgprjax = lgprjax.cli:main" in command


def test_the_command_works_elsewhere(installed: list[str], tmp_path: Path) -> None:
    command = Path(sysconfig.get_path("scripts")) / "lgprjax"
    assert installed
    for arguments in (["--help"], ["doctor"], ["map", "--help"]):
        done = subprocess.run([command, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []
