"""``lgprjax examples``: what the package brings along, copied whole or not at all."""

from pathlib import Path

from canon.commands import run, succeed
from lgprjax.formats import check_file
from lgprjax.simulation import read_site

ROOT = Path(__file__).parents[2]


def test_every_example_is_copied_and_can_be_used(tmp_path: Path) -> None:
    out = tmp_path / "my"
    told = succeed("examples", "-o", out)
    for folder in ("onboard", "sites", "tuning"):
        names = sorted(path.name for path in (ROOT / folder).iterdir() if path.is_file())
        assert sorted(path.name for path in (out / folder).iterdir()) == names
        assert all(name in told for name in names)
    for site in (out / "sites").glob("*.toml"):
        assert read_site(site)
    for vehicle in out.rglob("*.vehicle.toml"):
        assert not check_file(vehicle)


def test_nothing_is_replaced_unasked(tmp_path: Path) -> None:
    mine = tmp_path / "tuning" / "k_ratio.toml"
    mine.parent.mkdir()
    mine.write_text("mine", encoding="utf-8")
    done = run("examples", "-o", tmp_path)
    assert done.status == 1
    done.refusal.check("output", "--force", file=mine)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [mine]
    assert mine.read_text(encoding="utf-8") == "mine"
    succeed("examples", "-o", tmp_path, "--force")
    assert mine.read_text(encoding="utf-8") != "mine"
