"""``lgprjax events``: the events of a recorded run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import console, verdict, working

_STYLE = {"error": "bold red", "stop": "red", "check": "red", "refused": "yellow", "slow": "yellow", "arrived": "green"}


@dataclass(frozen=True)
class Events:
    """List the events of a recorded run, with the cause of every error, refusal, stop and slow-down."""

    run_folder: Annotated[Positional[Path], arg(metavar="RUN_FOLDER", help="folder of a recorded run")]
    json: Path | None = None
    """JSON file for the events; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> int:
        """Print the events."""
        from lgprjax.runtime.timeline import read_timeline

        with working(f"reading {self.run_folder}"):
            found = read_timeline(self.run_folder)
        check_outputs(self.json, force=self.force)
        table = Table("time s", "mode", "event", title=str(self.run_folder))
        for entry in found.entries:
            style = _STYLE.get(entry.kind, "")
            table.add_row(f"{entry.time_s:.1f}", entry.mode, Text(entry.text, style))
        console.print(table, highlight=False)
        ended = "" if found.end is not None else "; the recording was interrupted"
        done = "recorded, without commands" if found.only_recorded else "engaged, arrived at the end"
        summary = found.shortfall or done
        if self.json is not None:
            content = {
                "seconds": found.seconds,
                "engaged": found.engaged,
                "arrived": found.arrived,
                "shortfall": found.shortfall or None,
                "to_go_m": found.to_go_m if found.to_go_m == found.to_go_m else None,
                "end": found.end,
                "events": [entry._asdict() for entry in found.entries],
            }
            write_figures(self.json, content, force=self.force)
        following = f"recover {self.run_folder} -o X.drive.h5" if found.end is None else ""
        verdict(f"{found.seconds:.1f} s: {summary}{ended}", following)
        return 0
