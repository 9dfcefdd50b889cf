"""Pictures to zoom into: of a notebook's cell, and a file of their own."""

import tempfile
from html import escape
from pathlib import Path

from lgprjax.api.files import line_view
from lgprjax.api.fixes import Fixes
from lgprjax.api.inputs import PathLike, path_of, told_as_arguments
from lgprjax.errors import ArgumentError
from lgprjax.formats.store import atomic_output


class ZoomPage:
    """A page of pictures with zoom and pan by mouse, touch or keys; a notebook shows it below its cell.

    Attributes:
        title: title of the page.
        html: the page, self-contained.
    """

    def __init__(self, title: str, html: str) -> None:
        self.title, self.html = title, html

    def __repr__(self) -> str:
        return f"ZoomPage {self.title!r}, {len(self.html) / 1e6:.1f} MB; .save(PATH) writes it"

    def _repr_html_(self) -> str:
        held = f'srcdoc="{escape(self.html)}" title="{escape(self.title)}" width="100%" height="640"'
        return f"<div><iframe {held}></iframe></div>"

    def save(self, path: PathLike, *, force: bool = False) -> Path:
        """Write the page and return its path.

        Raises:
            InputError: the file exists (without ``force``) or cannot be written.
        """
        target = path_of(path, "path")
        with told_as_arguments(), atomic_output(target, force) as temporary:
            temporary.write_text(self.html, encoding="utf-8")
        return target


def zoom(
    shown: Fixes | PathLike, *, channel: int | None = None, raw: bool = False, velocity_m_per_ns: float | None = None
) -> ZoomPage:
    """Show fixes scan by scan, or the radargram of a recording, on a page with zoom.

    The pointer shows the values of a scan, or distance, travel time and depth. Zoom with the wheel, two fingers, or +
    and -.

    Args:
        shown: registered fixes, vendor file, drive log, or open drive.
        channel, raw, velocity_m_per_ns: options of a recording, as for ``view``.

    Raises:
        InputError: the file cannot be read or is a map, an option of recordings is given with fixes, or as for
            ``view``.

    Example:
        lx.zoom("drives/live.drive.h5", channel=5).save("live.html")
        lx.zoom(lx.register("site.map.h5", "drives/live.drive.h5"))    # as a cell's last line: below the cell
    """
    from lgprjax.report import write_drive_page, write_line_page

    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        if isinstance(shown, Fixes):
            if channel is not None or raw or velocity_m_per_ns is not None:
                raise ArgumentError(
                    "channel, raw, velocity_m_per_ns", "a recording (fixes have no such options)", "fixes"
                )
            title = shown.name
            write_drive_page(shown.result, page)
        else:
            view = line_view(path_of(shown, "shown"), channel, raw=raw, velocity_m_per_ns=velocity_m_per_ns)
            title = view.title
            write_line_page(view, page)
        return ZoomPage(title, page.read_text(encoding="utf-8"))
