"""``lgprjax map refine``: make the baselines of a map agree with each other."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.progress import console, progress_bar
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive.baseline_graph import AgreedBaselines
    from lgprjax.formats import MapFile


@dataclass(frozen=True)
class MapRefine:
    """Make the baselines of a map agree: each is registered on the others, its labels follow, a new map is written."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5")]
    output: Annotated[Path, arg(aliases=["-o"], help="database to write, NEW.map.h5")]
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Refine."""
        from lgprjax.archive.baseline_matches import plan_matches
        from lgprjax.archive.baseline_refine import refine_map
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import MapFile, locked_map

        for path in [self.output, *([] if self.json is None else [self.json])]:
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "the file exists")
        with locked_map(self.output), MapFile.open(self.file) as source:
            plan = plan_matches(source)
            with progress_bar("matching baselines", 2 * len(plan.pairs.station)) as progress:
                agreed = refine_map(
                    source, plan, self.output, force=self.force, progress=progress, stage=progress.stage
                )
            names = _names(source)
        _print(self.output, agreed, names)
        if self.json is not None:
            write_figures(self.json, _figures(agreed), force=self.force)


def _print(path: Path, agreed: "AgreedBaselines", names: list[str]) -> None:
    table = Table("baseline", "matches", "believed", "moved RMS m", "largest m", "label sigma m", "after m")
    for change in agreed.baselines:
        row = [str(change.drive), str(change.matches), str(change.kept)]
        row += [f"{change.moved_rms_m:.3f}", f"{change.moved_max_m:.3f}", f"{change.sigma_before_m:.3f}"]
        table.add_row(*row, f"{change.sigma_after_m:.3f}" if change.kept else "as it was")
    console.print(table)
    share = 100.0 * (1.0 - agreed.kept / agreed.used) if agreed.used else 0.0
    before, after = agreed.before, agreed.after
    lines = [
        f"{agreed.tried} places tried on earlier passes, {agreed.matched} matched, {agreed.used} of them not alone, "
        f"{share:.1f} % of those not believed; their sigmas times {agreed.noise_scale:.2f}",
        f"matches lay {before.rms_m:.3f} m RMS (median of all {before.median_m:.3f}) from their labels, and lie "
        f"{after.rms_m:.3f} m ({after.median_m:.3f}) from the corrected ones",
    ]
    if not agreed.kept:
        lines = [lines[0], "nothing ties the baselines of this map to each other: all labels stay as they are"]
    for change in agreed.baselines if agreed.kept else ():
        if not change.kept:
            lines.append(
                f"baseline {change.drive} ({names[change.drive]}) is tied to nothing: its labels stay as they are"
            )
    for line in [*lines, f"wrote {path}"]:
        console.print(line, highlight=False, markup=False, soft_wrap=True)


def _figures(agreed: "AgreedBaselines") -> dict[str, object]:
    """Plain values, for JSON; what is not a number is null."""
    changes = [
        {**change._asdict(), "sigma_after_m": change.sigma_after_m if change.kept else None}
        for change in agreed.baselines
    ]
    return {
        "tried": agreed.tried,
        "matched": agreed.matched,
        "used": agreed.used,
        "believed": agreed.kept,
        "noise_scale": agreed.noise_scale,
        "before": agreed.before._asdict() if agreed.kept else None,
        "after": agreed.after._asdict() if agreed.kept else None,
        "baselines": changes,
    }


def _names(source: "MapFile") -> list[str]:
    """File names of the drives that a map was built from, as far as it says."""
    inputs = source.provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    said = [str(row["file"]) for row in rows if isinstance(row, dict) and "file" in row]
    drives = len(source.description.label_sigma_m)
    return said if len(said) == drives else ["not named by the map"] * drives
