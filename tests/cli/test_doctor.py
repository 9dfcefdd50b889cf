"""``lgprjax doctor``: whole where all is well, and a line of advice for what was broken on purpose."""

import json
from importlib import metadata
from pathlib import Path

import pyproj
import pytest
from packaging.requirements import Requirement

from lgprjax.cli import installation as health_of_machine
from lgprjax.cli import installation as health_of_packages
from lgprjax.cli.doctor import Doctor
from lgprjax.cli.installation import InstallationFinding


def of(findings: list[InstallationFinding], name: str) -> InstallationFinding:
    return next(finding for finding in findings if finding.name == name)


def test_everything_is_well_here(tmp_path: Path) -> None:
    assert Doctor(json=tmp_path / "d.json").run() == 0
    found = {row["name"]: row for row in json.loads((tmp_path / "d.json").read_text(encoding="utf-8"))}
    for name in ("device", "projections", "pictures", "data_schema"):
        assert found[name]["verdict"] == "good", found[name]
    assert found["device"]["found"].startswith("1 cpu")
    assert not any(row["verdict"] == "bad" for row in found.values())


def test_a_core_package_of_the_wrong_version_or_missing_is_bad() -> None:
    numpy = metadata.version("numpy")
    assert health_of_packages._core(Requirement("numpy>=1")) == InstallationFinding("numpy", numpy, "good")
    old = health_of_packages._core(Requirement("numpy<1"))
    assert (old.verdict, old.advice) == ("bad", 'pip install "numpy<1"')
    assert health_of_packages._core(Requirement("no-such-package-of-anyone>=2")).verdict == "bad"


def test_an_extra_is_there_absent_or_of_the_wrong_version() -> None:
    there = health_of_packages._extra("onboard", [Requirement("numpy>=1")])
    assert there.verdict == "good"
    absent = health_of_packages._extra("onboard", [Requirement("numpy>=1"), Requirement("no-such-package-of-anyone")])
    assert absent.verdict == "absent"
    assert 'pip install "lgprjax[onboard]"' in absent.advice
    assert health_of_packages._extra("onboard", [Requirement("numpy<1")]).verdict == "look"


def test_names_in_brackets_are_shown(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    found = [InstallationFinding("[onboard]", "[/lost] of [these]", "absent")]
    monkeypatch.setattr(health_of_packages, "look_at_packages", lambda: found)
    assert Doctor().run() == 0
    told = capsys.readouterr().out
    assert "[onboard]" in told
    assert "[/lost] of [these]" in told


def test_every_extra_says_what_it_is_for() -> None:
    try:
        extras = metadata.metadata("lgprjax").get_all("Provides-Extra") or []
    except metadata.PackageNotFoundError:
        pytest.skip("lgprjax is not installed, it runs from the source tree")
    assert set(extras) <= set(health_of_packages._EXTRA_FOR)


def test_a_device_that_cannot_start_is_bad_and_its_reason_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_PLATFORMS", "no_such_platform")
    found = health_of_machine._device()
    assert found.verdict == "bad"
    assert "no_such_platform" in found.found


def test_a_device_that_hangs_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(health_of_machine, "_PROBE", "import time; time.sleep(60)")
    monkeypatch.setattr(health_of_machine, "_START_S", 0.5)
    assert health_of_machine._device().found.endswith(" 0.5 s")


def test_variables_that_change_the_result_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_ENABLE_X64", "1")
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "/proc/no/cache")
    found = health_of_machine._environment()
    assert of(found, "JAX_ENABLE_X64").verdict == "look"
    assert of(found, "JAX_COMPILATION_CACHE_DIR").verdict == "look"


def test_a_folder_that_cannot_be_written_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir("/proc")
    found = health_of_machine._disk()
    assert found.verdict == "look"
    assert "/proc" in found.found


def test_projections_that_are_wrong_or_fail_are_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    swapped = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32632", always_xy=True)
    monkeypatch.setattr(pyproj.Transformer, "from_crs", lambda *_, **__: swapped)
    assert health_of_machine._projection().verdict == "bad"

    def fails(*_: object, **__: object) -> None:
        raise pyproj.exceptions.CRSError("no_context")

    monkeypatch.setattr(pyproj.Transformer, "from_crs", fails)
    found = health_of_machine._projection()
    assert (found.verdict, found.found) == ("bad", "no_context")
