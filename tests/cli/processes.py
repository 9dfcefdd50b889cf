"""Commands in processes of their own, and runs whose processes may be late."""

import os
import subprocess
import sys
from pathlib import Path

from canon.commands import Done

ROOT = Path(__file__).resolve().parents[2]
_CODE = "import sys; from lgprjax.cli import main; main(sys.argv[1:])"


def lgprjax(*arguments: str, limit_s: float = 1200.0) -> Done:
    """The command in a process of its own."""
    command = [sys.executable, "-c", _CODE, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=limit_s, check=False, env=os.environ)
    return Done(done.returncode, done.stdout, done.stderr)


def quick(text: str, path: Path) -> Path:
    """Write the configuration of an example run, its outputs beside it.

    Where other tests run beside it the loop may be late; what is shown is that everything fits together.
    """
    text = text.replace("../out/onboard/", "")
    for name in ("made_up.vehicle.toml", "made_up_flail.vehicle.toml", "cart.vehicle.toml", "field.geojson"):
        text = text.replace(f'"{name}"', f'"{ROOT / "onboard" / name}"')
    text += "\n[supervision]\ncontrol_s = 5.0\nothers_s = 20.0\nstart_s = 300.0\n\n[display]\nport = 0\n"
    path.write_text(text, encoding="utf-8")
    return path
