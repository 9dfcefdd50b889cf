"""The package as it is installed: its data, its types, its command, outside of the repository."""

import re
import subprocess
import sysconfig
import tomllib
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


def test_the_source_distribution_names_files_that_there_are() -> None:
    told = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for name in told["tool"]["hatch"]["build"]["targets"]["sdist"]["include"]:
        assert (_ROOT / name).exists(), name


def test_the_command_works_elsewhere(installed: list[str], tmp_path: Path) -> None:
    command = Path(sysconfig.get_path("scripts")) / "lgprjax"
    assert installed
    for arguments in (["--help"], ["doctor"], ["map", "--help"]):
        done = subprocess.run([command, *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stdout + done.stderr
    assert list(tmp_path.iterdir()) == []
