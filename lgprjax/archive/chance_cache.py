"""The chance of a map that is to be registered against: out of its file, else measured once and remembered."""

import os
from contextlib import suppress
from pathlib import Path

from lgprjax.archive.map_chance import measure_chance
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, atomic_output, chance_as_text, chance_of_text
from lgprjax.registration import Chance


def chance_of(source: MapFile) -> Chance:
    """The chance of a map.

    Maps of older versions hold none: theirs is measured, which takes seconds to minutes, and kept in the user's cache
    folder under the hash of the map's file. A cache that cannot be read or written costs the time and nothing else.
    """
    if source.chance is not None:
        return source.chance
    cache = cache_path(source)
    with suppress(OSError, UnicodeDecodeError):
        kept = chance_of_text(cache.read_text(encoding="utf-8"))
        if kept is not None:
            return kept
    chance = measure_chance(source)
    with suppress(OSError, InputError):
        cache.parent.mkdir(parents=True, exist_ok=True)
        with atomic_output(cache, force=True) as temporary:
            temporary.write_text(chance_as_text(chance), encoding="utf-8")
    return chance


def cache_path(source: MapFile) -> Path:
    """Where the chance of a map without its own is kept: ``$XDG_CACHE_HOME/lgprjax``, or ``~/.cache/lgprjax``."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "lgprjax" / f"chance-{file_hash(source.path)}.json"
