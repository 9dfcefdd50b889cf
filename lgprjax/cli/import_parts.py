"""What the import verbs share: the output, the site's origin, and the closing line."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from lgprjax.cli.progress import console

if TYPE_CHECKING:
    from lgprjax.formats import Place

Output = Annotated[Path, arg(aliases=["-o"], help="drive log to write, X.drive.h5")]
Force = Annotated[bool, arg(help="replace an output that exists")]


@dataclass(frozen=True)
class Origin:
    """Where on the earth the recording is put."""

    latitude_deg: float = 0.0
    """latitude of the site's origin, WGS-84"""
    longitude_deg: float = 0.0
    """longitude of the site's origin, WGS-84"""
    heading_deg: float = 90.0
    """direction of the lines, clockwise from true north"""

    def place(self) -> "Place":
        """The origin as the importers take it."""
        from lgprjax.formats import Place

        return Place(self.latitude_deg, self.longitude_deg, self.heading_deg)


def finished(output: Path, origin: Origin | None) -> None:
    """Say what was written, and whether its place on the earth is a stand-in (``None``: it is not)."""
    console.print(f"wrote {output}", highlight=False, markup=False, soft_wrap=True)
    if origin is not None and origin.latitude_deg == 0.0 and origin.longitude_deg == 0.0:
        console.print("the site's origin was put at latitude 0, longitude 0 (see --latitude-deg)", highlight=False)
