"""Commands in this process."""

import pytest

from lgprjax.cli import main


def run(*words: object) -> int:
    """Exit status of ``lgprjax``."""
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return int(end.value.code or 0)
