"""``python -m pictures``: draw the pictures of the documentation into ``docs/pictures``."""

import argparse
import sys
import tempfile
import time
from pathlib import Path

from pictures import digest
from pictures.catalogue import BROWSED, MEASURED, PICTURES, Workshop


def main() -> int:
    """Draw the pictures that are named, or all; the exit status."""
    parser = argparse.ArgumentParser(prog="python -m pictures", description="Draw the pictures of the documentation.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="a picture, such as hero or hero.webp; default: all")
    parser.add_argument("--list", action="store_true", help="list the pictures, and those that are out of date")
    parser.add_argument("--output", type=Path, metavar="DIR", help="write to this folder, and no sources.json")
    chosen = parser.parse_args()
    if chosen.list:
        return _list()
    by_stem = {name.partition(".")[0]: name for name in PICTURES}
    names = [by_stem.get(name.partition(".")[0], name) for name in chosen.names] or list(PICTURES)
    unknown = [name for name in names if name not in PICTURES]
    if unknown:
        parser.error(f"no such picture: {', '.join(unknown)}; --list shows them")
    return _draw(names, chosen.output)


def _list() -> int:
    old = set(digest.stale({name: picture.sources for name, picture in PICTURES.items()}))
    for name in PICTURES:
        print(f"{name}: out of date" if name in old else name)
    for name, command in MEASURED.items():
        print(f"{name}: a measurement, {command}")
    return 0


def _draw(names: list[str], output: Path | None) -> int:
    # Imported late: a list needs no JAX.
    from lgprjax.cli.command import keep_compiled
    from pictures.loop import looks_alike
    from pictures.reports import NoDataError

    keep_compiled()
    folder = output or digest.FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    # Before drawing: a file that changes meanwhile makes the picture out of date.
    sums = {name: digest.sources_sha256(PICTURES[name].sources) for name in names}
    drawn, skipped = {}, []
    with tempfile.TemporaryDirectory() as scratch:
        shop = Workshop(Path(scratch))
        for name in names:
            begun_s = time.monotonic()
            # A picture that fails leaves the file of before.
            made = Path(scratch) / name
            try:
                PICTURES[name].draw(shop, made)
            except NoDataError as error:
                skipped.append(f"SKIPPED {name}: {error}")
                print(skipped[-1], file=sys.stderr, flush=True)
                continue
            if not (name in BROWSED and (folder / name).exists() and looks_alike(made, folder / name)):
                (folder / name).write_bytes(made.read_bytes())
            drawn[name] = PICTURES[name].sources, sums[name]
            print(f"{name}: {time.monotonic() - begun_s:.1f} s", flush=True)
    if output is None:
        digest.write_record(drawn)
    for line in skipped:
        print(line, file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
