"""``lgprjax examples``: what the package brings along, copied whole or not at all."""

from pathlib import Path

import pytest

from lgprjax.cli import main
from lgprjax.formats import check_file
from lgprjax.simulation import read_site

ROOT = Path(__file__).parents[2]


def status_of(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(argument) for argument in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_every_example_is_copied_and_can_be_used(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "my"
    assert status_of("examples", "-o", out) == 0
    told = capsys.readouterr().out
    for folder in ("onboard", "sites", "tuning"):
        names = sorted(path.name for path in (ROOT / folder).iterdir() if path.is_file())
        assert sorted(path.name for path in (out / folder).iterdir()) == names
        assert all(name in told for name in names)
    for site in (out / "sites").glob("*.toml"):
        assert read_site(site)
    for vehicle in out.rglob("*.vehicle.toml"):
        assert not check_file(vehicle)


def test_nothing_is_replaced_unasked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "tuning" / "k_ratio.toml"
    mine.parent.mkdir()
    mine.write_text("mine", encoding="utf-8")
    assert status_of("examples", "-o", tmp_path) == 1
    assert f"{mine}: output: expected a new file, or --force, found one that exists" in capsys.readouterr().err
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]
    assert mine.read_text(encoding="utf-8") == "mine"
    assert status_of("examples", "-o", tmp_path, "--force") == 0
    assert mine.read_text(encoding="utf-8") != "mine"
