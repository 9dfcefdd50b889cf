"""Settings of every test and every validation: the shipped float32, no silent broadcasting, no silent promotion."""

import atexit
import gc
import json
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine

from canon.arithmetic import ONE_ARITHMETIC
from canon.course import make_course_run
from canon.shared import shared_folder
from canon.site import Site, make_site, site_in
from canon.trench import TrenchSite, make_trench_site, trench_site_in

# The benchmarks are not in the wheel. Behind everything else, so that the installed package stays what is tested.
sys.path.append(str(Path(__file__).parent))
# Before the first program is compiled. A validation measures what is shipped.
if "LGPRJAX_VALIDATION" not in os.environ:
    for variable, setting in ONE_ARITHMETIC.items():
        os.environ.setdefault(variable, setting)
# A shell that starts the tests in the background has them, and what they start, ignore Ctrl-C; some of them press it.
signal.signal(signal.SIGINT, signal.default_int_handler)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
# An optimisation only; the suite passes without it. Every program is kept, and the key does not hold the folder's path,
# so that workers, the programs that tests start, the next run and another clone need not compile it again.
_CACHE = os.environ.get("LGPRJAX_TEST_CACHE")
if _CACHE:
    for name, value in {
        "jax_compilation_cache_dir": _CACHE,
        "jax_persistent_cache_min_compile_time_secs": 0.0,
        "jax_persistent_cache_min_entry_size_bytes": -1,
        "jax_persistent_cache_enable_xla_caches": "none",
    }.items():
        jax.config.update(name, value)
        os.environ[name.upper()] = str(value)
else:
    jax.config.update("jax_compilation_cache_dir", None)
# A worker holds millions of objects, most of them compiled programs' descriptions: full collections are a twentieth of
# the time, and find next to nothing.
gc.set_threshold(100_000, 20, 100)
# Matplotlib keeps its list of fonts in the home folder, and believes a list that was written while an environment was
# rebuilt and that lacks its own fonts. A list of the run's own, shared with the workers and the programs started.
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["MPLCONFIGDIR"] = tempfile.mkdtemp(prefix="lgprjax-matplotlib-")
    atexit.register(shutil.rmtree, os.environ["MPLCONFIGDIR"], ignore_errors=True)

# Files that drive the whole chain, minutes each: first, so that no worker is left with one when the others are done.
# Processes that tests start come after the files that compile the same programs and cache them.
_LONG = (
    *(
        "cli/test_calibrate.py",
        "frozen",
        "test_public.py",
        "batch",
        "recordings",
        "test_docs.py",
        "registration",
        "simulation",
    ),
    *("cli", "navigation", "runtime", "studies", "report", "scene"),
)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Long files first, in the order of ``_LONG``; of a validation, only tests that have not passed yet."""

    def place(item: pytest.Item) -> int:
        path = item.path.as_posix()
        return next((number for number, long in enumerate(_LONG) if f"/tests/{long}" in path), len(_LONG))

    items.sort(key=place)
    state = os.environ.get("LGPRJAX_VALIDATION")
    if state:
        from validation.__main__ import results_in

        results = results_in(Path(state), os.environ["LGPRJAX_VALIDATION_SOURCE"])
        passed = {test for test, row in results.items() if row["outcome"] == "passed"}
        config.hook.pytest_deselected(items=[item for item in items if item.nodeid in passed])
        items[:] = [item for item in items if item.nodeid not in passed]


# Of the 65,530 that Linux gives a process by default. A compiled program takes several, and a worker that runs for an
# hour compiled so many that mapping memory failed, in the middle of a compile, without a word.
_MOST_MAPPINGS = 40_000


@pytest.fixture(scope="module", autouse=True)
def few_programs() -> Iterator[None]:
    """Forget compiled programs after a file that leaves many; the next ones that need them load them from the cache."""
    yield
    mappings = Path("/proc/self/maps")
    if mappings.exists() and len(mappings.read_bytes().splitlines()) > _MOST_MAPPINGS:
        jax.clear_caches()


@pytest.fixture(scope="module", autouse=True)
def plain_pictures(request: pytest.FixtureRequest) -> Iterator[None]:
    """Draw pictures without laying them out, which takes longer than the commands themselves.

    Tests of pictures, validations, and commands that run as programs of their own lay them out.
    """
    root, *rooms = request.path.relative_to(request.config.rootpath).parts
    with pytest.MonkeyPatch.context() as patch:
        if root != "validation" and rooms[0] != "report":
            patch.setattr(ConstrainedLayoutEngine, "execute", lambda *_: None)
        yield


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of the real recordings; the test skips, and says so, where the variable is not set."""
    folder = os.environ.get("LGPRJAX_REAL_DATA")
    if not folder:
        pytest.skip("LGPRJAX_REAL_DATA is not set: the real recordings are not tested here")
    path = Path(folder)
    if not (path / "SHA256SUMS").is_file():
        pytest.fail(f"LGPRJAX_REAL_DATA={folder} holds no recordings (no SHA256SUMS)")
    return path


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    """A generated road of 40 m with two baselines, a live drive and an impostor."""
    return site_in(shared_folder(tmp_path_factory, "site", lambda folder: make_site(folder, seed=1, length_m=40.0)))


@pytest.fixture(scope="session")
def trench(tmp_path_factory: pytest.TempPathFactory) -> TrenchSite:
    """A generated road of 22 m that is dug up over 6 m after it was mapped, and two drives later."""
    trench_m = (9.0, 15.0)
    folder = shared_folder(tmp_path_factory, "trench", lambda folder: make_trench_site(folder, 3, 22.0, trench_m))
    return trench_site_in(folder, trench_m)


@pytest.fixture(scope="session")
def course_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with map, route and configuration of a course of 150 m."""
    return shared_folder(tmp_path_factory, "course", make_course_run)


_setup_s: dict[str, float] = {}


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note each test of a validation as it ends, so that an interrupted one can be resumed."""
    state = os.environ.get("LGPRJAX_VALIDATION")
    if not state or "PYTEST_XDIST_WORKER" in os.environ:
        return
    if report.when == "setup":
        _setup_s[report.nodeid] = report.duration
    if report.when != "call" and report.passed:
        return
    row = {
        "source": os.environ["LGPRJAX_VALIDATION_SOURCE"],
        "test": report.nodeid,
        "outcome": report.outcome,
        "seconds": round(report.duration + (_setup_s[report.nodeid] if report.when == "call" else 0.0), 2),
        "figures": dict(report.user_properties),
    }
    # A line of its own, also after one that was cut.
    with Path(state).open("a", encoding="utf-8") as file:
        file.write("\n" + json.dumps(row) + "\n")
