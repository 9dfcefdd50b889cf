"""``lgprjax doctor``: check installation and machine, with advice for each problem."""

from dataclasses import asdict, dataclass
from pathlib import Path

from rich.table import Table
from rich.text import Text

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import console, say, verdict, working

_STYLE = {"good": "green", "absent": "dim", "look": "yellow", "bad": "bold red"}


@dataclass(frozen=True)
class Doctor:
    """Check the installation and the machine, with advice for each problem."""

    onboard: bool = False
    """also measure, for about a minute, whether this machine registers the 126 scans per second of an array"""
    json: Path | None = None
    """JSON file for the findings; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> int:
        """Check; status 1 if something that every command needs is missing or wrong."""
        from lgprjax.cli.installation import look_at_machine, look_at_onboard, look_at_packages

        check_outputs(self.json, force=self.force)
        with working("checking"):
            findings = [*look_at_packages(), *look_at_machine()]
        if self.onboard:
            with working("simulating a course of 60 m and registering its scans"):
                findings += look_at_onboard()
        table = Table("item", "found", "verdict")
        for finding in findings:
            table.add_row(finding.name, finding.found, Text(finding.verdict, _STYLE[finding.verdict]))
        console.print(table)
        for finding in findings:
            if finding.advice:
                line = f"{finding.verdict}: {finding.name}: {finding.advice}"
                say(line)
        if self.json is not None:
            write_figures(self.json, [asdict(finding) for finding in findings], force=self.force)
        bad = [finding.name for finding in findings if finding.verdict == "bad"]
        if bad:
            verdict(f"bad: {', '.join(bad)}; lgprjax cannot be used on this machine")
        else:
            verdict("lgprjax can be used on this machine", "demo")
        return int(bool(bad))
