"""One truth on board and off: the fixes of a recorded run are those of its drive log, registered again.

With a stepped-frequency radar: ``validation/loops/test_one_truth.py``.
"""

from pathlib import Path

import pandas as pd
import pytest

from canon.site import Site
from lgprjax.cli import main
from validation.loops.searched_run import check_one_truth, searched_run

_SCANS = 200


@pytest.mark.parametrize("search", ["exhaustive", "filter"])
def test_the_fixes_of_a_run_are_those_of_its_drive_log(site: Site, tmp_path: Path, search: str) -> None:
    run, path = tmp_path / "recorded", tmp_path / "run.drive.h5"
    searched_run(site, run, _SCANS, search)
    again = check_one_truth(site, run, path, _SCANS)
    # The command finds the options that the run was searched with by itself.
    with pytest.raises(SystemExit) as ended:
        main(["register", str(site.map), str(path), "-o", str(tmp_path / "again"), "--track"])
    assert ended.value.code == 0
    table = pd.read_csv(tmp_path / "again" / "run.fixes.csv")
    assert list(table["code"]) == list(again.table["code"])
