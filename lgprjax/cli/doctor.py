"""``lgprjax doctor``: report installation and machine, with advice for each problem."""

from dataclasses import asdict, dataclass
from pathlib import Path

from rich.table import Table
from rich.text import Text

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import console, working

_STYLE = {"good": "green", "absent": "dim", "look": "yellow", "bad": "bold red"}


@dataclass(frozen=True)
class Doctor:
    """Report the installation and the machine, with advice for each problem."""

    onboard: bool = False
    """also measure, for about a minute, whether this machine keeps up with the 126 scans per second of an array"""
    json: Path | None = None
    """also write the findings to this file, or - for standard output"""
    force: bool = False
    """replace that file if it exists"""

    def run(self) -> int:
        """Check; status 1 if something that every verb needs is missing or wrong."""
        from lgprjax.cli.installation import look_at_machine, look_at_packages

        check_outputs(self.json, force=self.force)
        with working("looking"):
            findings = [*look_at_packages(), *look_at_machine()]
        if self.onboard:
            from lgprjax.cli.real_time import look_at_onboard

            with working("making a course of 60 m, and searching its scans"):
                findings += look_at_onboard()
        table = Table("what", "found", "verdict")
        for finding in findings:
            table.add_row(finding.name, finding.found, Text(finding.verdict, _STYLE[finding.verdict]))
        console.print(table)
        for finding in findings:
            if finding.advice:
                line = f"{finding.verdict}: {finding.name}: {finding.advice}"
                console.print(line, highlight=False, markup=False, soft_wrap=True)
        if self.json is not None:
            write_figures(self.json, [asdict(finding) for finding in findings], force=self.force)
        worst = any(finding.verdict == "bad" for finding in findings)
        console.print("lgprjax cannot be relied on here" if worst else "lgprjax can be used here", highlight=False)
        return int(worst)
