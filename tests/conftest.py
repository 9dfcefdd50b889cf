"""Settings of every test: the shipped float32, no silent broadcasting, no silent promotion."""

import atexit
import gc
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import jax
import pytest

from generated import Site, make_site
from trench_site import TrenchSite, make_trench_site

# The benchmarks are not in the wheel. Behind everything else, so that the installed package stays what is tested.
sys.path.append(str(Path(__file__).parents[1]))
# A shell that starts the tests in the background has them, and what they start, ignore Ctrl-C; some of them press it.
signal.signal(signal.SIGINT, signal.default_int_handler)
jax.config.update("jax_numpy_rank_promotion", "raise")
jax.config.update("jax_numpy_dtype_promotion", "strict")
# An optimisation only; the suite passes without it. The workers of a run, and the programs that tests start, need not
# compile what another has compiled: two thirds of the suite's time are compiles.
_CACHE = os.environ.get("LGPRJAX_TEST_CACHE")
jax.config.update("jax_compilation_cache_dir", _CACHE or None)
if _CACHE:
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.3)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = _CACHE
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0.3"
# A worker holds millions of objects, most of them compiled programs' descriptions: full collections are a twentieth of
# the time, and find next to nothing.
gc.set_threshold(100_000, 20, 100)
# Matplotlib keeps its list of fonts in the home folder, and believes a list that was written while an environment was
# rebuilt and that lacks its own fonts. A list of the run's own, shared with the workers and the programs started.
if "PYTEST_XDIST_WORKER" not in os.environ:
    os.environ["MPLCONFIGDIR"] = tempfile.mkdtemp(prefix="lgprjax-matplotlib-")
    atexit.register(shutil.rmtree, os.environ["MPLCONFIGDIR"], ignore_errors=True)

# Files that drive the whole chain, minutes each: first, so that no worker is left with one when the others are done.
_LONG = (
    *("cli/test_run.py", "frozen", "batch", "test_notebooks.py", "mapping", "simulation", "runtime"),
    *("test_public.py", "test_docs.py", "test_commands.py", "cli"),
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Long files first, in the order of ``_LONG``; the others as they were."""
    tests = Path(__file__).parent

    def place(item: pytest.Item) -> int:
        path = item.path.relative_to(tests).as_posix()
        return next((number for number, long in enumerate(_LONG) if path.startswith(long)), len(_LONG))

    items.sort(key=place)


# Of the 65,530 that Linux gives a process by default. A compiled program takes several, and a worker that runs for an
# hour compiled so many that mapping memory failed, in the middle of a compile, without a word.
_MOST_MAPPINGS = 20_000


@pytest.fixture(scope="module", autouse=True)
def few_programs() -> Iterator[None]:
    """Forget compiled programs after a file that leaves many; the next ones that need them load them from the cache."""
    yield
    mappings = Path("/proc/self/maps")
    if mappings.exists() and len(mappings.read_bytes().splitlines()) > _MOST_MAPPINGS:
        jax.clear_caches()


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
    return make_site(tmp_path_factory.mktemp("site"), seed=1, length_m=40.0)


@pytest.fixture(scope="session")
def trench(tmp_path_factory: pytest.TempPathFactory) -> TrenchSite:
    """A generated road of 22 m that is dug up over 6 m after it was mapped, and two drives later."""
    return make_trench_site(tmp_path_factory.mktemp("trench"), 3, 22.0, (9.0, 15.0))
