"""``lgprjax check``: hold files against their schema."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.progress import console, working


@dataclass(frozen=True)
class Check:
    """Hold files against the data schema: every place that is not as it should be."""

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="FILE...", help=".drive.h5, .map.h5, .fixes.h5, .fixes.csv or .vehicle.toml"),
    ]
    json: Path | None = None
    """also write the findings to this file"""
    force: bool = False
    """replace that file if it exists"""

    def run(self) -> int:
        """Check; status 1 if any file cannot be used."""
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import check_file

        require_files(self.files, "files")
        findings = []
        for path in self.files:
            with working(f"checking {path}"):
                found = check_file(path)
            findings += found
            for finding in found:
                console.print(str(finding), highlight=False, soft_wrap=True, markup=False)
            if not found:
                console.print(f"{path}: ok", highlight=False, soft_wrap=True, markup=False)
        if self.json is not None:
            write_figures(self.json, [asdict(finding) for finding in findings], force=self.force)
        return int(any(finding.severity == "error" for finding in findings))
