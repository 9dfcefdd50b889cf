"""Checks of ``lgprjax doctor``: packages; device, arithmetic, memory and disk of this machine."""

import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib import metadata, resources
from pathlib import Path
from shutil import disk_usage
from typing import Literal

import numpy as np
from packaging.requirements import Requirement

import lgprjax
from lgprjax.machine import usable_cores

# Whether lgprjax's requirements are installed, complete, and in the required versions.

_EXTRA_FOR = {
    "batch": "register --scheduler",
    "bench": "peer programs of python -m benchmarks",
    "docs": "make docs",
    "gis": "cover export to GeoPackage",
    "lint": "make lint, make types",
    "live": "the live view of lgprjax run",
    "log": "import mcap, export",
    "rosbag": "import rosbag",
    "notebook": "notebooks/",
    "onboard": "lgprjax run",
    "signals": "import signals from Parquet",
    "test": "make test",
}
_FOR_DEVELOPERS = {"docs", "lint", "test"}


@dataclass(frozen=True)
class InstallationFinding:
    """Result of a check.

    Attributes:
        name: name of the item.
        found: version or state in words.
        verdict: good; absent: not installed, not an error; look: inspect; bad: lgprjax cannot be used.
        advice: corrective action; empty if none is needed.
    """

    name: str
    found: str
    verdict: Literal["good", "absent", "look", "bad"]
    advice: str = ""


def look_at_packages() -> list[InstallationFinding]:
    """lgprjax, its required packages, and the packages of its extras."""
    try:
        required = [Requirement(line) for line in metadata.requires("lgprjax") or ()]
        own = InstallationFinding("lgprjax", metadata.version("lgprjax"), "good")
    except metadata.PackageNotFoundError:
        advice = "running from a source tree; install it: make demo, or pip install ."
        return [InstallationFinding("lgprjax", f"{lgprjax.__version__}, not installed", "look", advice), *_data()]
    core = [requirement for requirement in required if requirement.marker is None]
    findings = [own, *(_core(requirement) for requirement in core)]
    extras = sorted(metadata.metadata("lgprjax").get_all("Provides-Extra") or ())
    for extra in extras:
        needed = [r for r in required if r.marker is not None and r.marker.evaluate({"extra": extra})]
        if extra not in _FOR_DEVELOPERS:
            findings.append(_extra(extra, needed))
    return [*findings, *_data()]


def _core(requirement: Requirement) -> InstallationFinding:
    found = _version(requirement.name)
    advice = f'pip install "{requirement.name}{requirement.specifier}"'
    if found is None:
        return InstallationFinding(requirement.name, "missing", "bad", advice)
    if not requirement.specifier.contains(found, prereleases=True):
        return InstallationFinding(requirement.name, f"{found}, required {requirement.specifier}", "bad", advice)
    return InstallationFinding(requirement.name, found, "good")


def _extra(extra: str, requirements: list[Requirement]) -> InstallationFinding:
    """Whether an extra is installed, absent, or incomplete."""
    name, serves = f"[{extra}]", _EXTRA_FOR.get(extra, "")
    advice = f'pip install "lgprjax[{extra}]" ({serves})' if serves else f'pip install "lgprjax[{extra}]"'
    versions = {requirement.name: _version(requirement.name) for requirement in requirements}
    there = {package: found for package, found in versions.items() if found is not None}
    wrong = [
        f"{requirement.name} {there[requirement.name]}, required {requirement.specifier}"
        for requirement in requirements
        if requirement.name in there and not requirement.specifier.contains(there[requirement.name], prereleases=True)
    ]
    if wrong:
        return InstallationFinding(name, "; ".join(wrong), "look", advice)
    if len(there) == len(versions):
        return InstallationFinding(name, ", ".join(f"{package} {found}" for package, found in there.items()), "good")
    missing = ", ".join(package for package in versions if package not in there)
    # Other software installs some of these packages too: an incomplete extra counts as absent.
    return InstallationFinding(name, f"missing: {missing}", "absent", advice)


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _data() -> list[InstallationFinding]:
    """The data schemas, which every reader needs."""
    from lgprjax.formats.schema import load_schema

    names = ("drive", "map", "fixes", "route", "vehicle")
    try:
        versions = ", ".join(f"{name} {load_schema(name).version}" for name in names)
    except (OSError, ValueError, KeyError) as error:
        return [InstallationFinding("data_schema", str(error), "bad", "pip install --force-reinstall lgprjax")]
    packaged = Path(str(resources.files("lgprjax"))) / "data_schema"
    where = "of the package" if packaged.is_dir() else "of the source tree"
    return [InstallationFinding("data_schema", f"{versions} ({where})", "good")]


_START_S = 120.0
_LEAST_MEMORY_GB, _LEAST_DISK_GB = 4.0, 2.0
# In a separate process: a driver may hang or crash.
_PROBE = """
import jax, jax.numpy as jnp, numpy as np
device = jax.devices()[0]
left = np.random.default_rng(0).normal(size=(256, 256)).astype(np.float32)
wrong = np.abs(np.asarray(jnp.asarray(left) @ jnp.asarray(left)) - left.astype(np.float64) @ left).max()
print(len(jax.devices()), device.platform, device.device_kind, wrong, sep="|")
"""
_LARGEST_ERROR = 0.05
"""Error of a sum of 256 products around 1: 1e-4 in float32, more in TF32 and bfloat16."""


def look_at_machine() -> list[InstallationFinding]:
    """Checks of this machine that need no input file."""
    findings = [_device(), _cores(), _memory(), _disk(), _projection(), _picture(), _real_time()]
    return [*findings, *_environment()]


def _device() -> InstallationFinding:
    advice = "reinstall jax for this machine, or set JAX_PLATFORMS=cpu"
    try:
        done = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, timeout=_START_S)
    except subprocess.TimeoutExpired:
        return InstallationFinding("device", f"no answer in {_START_S:g} s", "bad", advice)
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        said = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        return InstallationFinding("device", said, "bad", advice)
    count, platform, kind, wrong = lines[-1].split("|")
    found = f"{count} {platform} ({kind})" if platform != kind else f"{count} {platform}"
    if float(wrong) > _LARGEST_ERROR:
        precision = "set JAX_DEFAULT_MATMUL_PRECISION=float32: products of this device are too inaccurate"
        return InstallationFinding("device", f"{found}, matrix product wrong by {float(wrong):.2g}", "look", precision)
    return InstallationFinding("device", found, "good")


def _cores() -> InstallationFinding:
    cores = usable_cores()
    if cores < 2:
        return InstallationFinding("cores", str(cores), "look", "lgprjax run needs at least two")
    return InstallationFinding("cores", str(cores), "good")


def _memory() -> InstallationFinding:
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return InstallationFinding("memory", "unknown", "absent")
    total_gb = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    if total_gb < _LEAST_MEMORY_GB:
        return InstallationFinding(
            "memory", f"{total_gb:.1f} GB", "look", f"at least {_LEAST_MEMORY_GB:g} GB recommended for maps of arrays"
        )
    return InstallationFinding("memory", f"{total_gb:.1f} GB", "good")


def _disk() -> InstallationFinding:
    here = Path.cwd()
    free_gb = disk_usage(here).free / 1e9
    try:
        with tempfile.TemporaryFile(dir=here) as file:
            file.write(b"lgprjax")
    except OSError as error:
        return InstallationFinding("disk", f"{here}: {error.strerror}", "look", "choose another folder for outputs")
    if free_gb < _LEAST_DISK_GB:
        return InstallationFinding("disk", f"{free_gb:.1f} GB free", "look", "an array records 0.5 MB per second")
    return InstallationFinding("disk", f"{free_gb:.1f} GB free in this folder", "good")


def _projection() -> InstallationFinding:
    """Check the projection of the point on the equator in the middle of UTM zone 31."""
    import pyproj

    advice = "unset PROJ_DATA and PROJ_LIB, or reinstall pyproj: its database belongs to another version"
    try:
        east, north = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True).transform(3.0, 0.0)
    except Exception as error:
        return InstallationFinding("projections", str(error), "bad", advice)
    if not np.allclose([east, north], [500000.0, 0.0], atol=1e-3):
        return InstallationFinding("projections", f"{east:.3f}, {north:.3f} for 500000, 0", "bad", advice)
    return InstallationFinding("projections", f"PROJ {pyproj.proj_version_str}", "good")


def _picture() -> InstallationFinding:
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib.figure import Figure

    try:
        with tempfile.TemporaryFile() as file:
            Figure().savefig(file)
    except Exception as error:
        return InstallationFinding("pictures", str(error), "bad", "reinstall matplotlib")
    return InstallationFinding("pictures", f"matplotlib {mpl.__version__}", "good")


def _real_time() -> InstallationFinding:
    """Only the onboard runtime needs it."""
    if sys.platform != "linux":
        return InstallationFinding("real-time priority", "not on this system", "absent", "lgprjax run works without it")
    import resource

    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
    if allowed == 0 and os.geteuid() != 0:
        advice = "for lgprjax run: LimitRTPRIO in the systemd unit, or rtprio in limits.conf"
        return InstallationFinding("real-time priority", "not permitted", "absent", advice)
    return InstallationFinding("real-time priority", "permitted", "good")


def _environment() -> list[InstallationFinding]:
    """Environment variables that change JAX results or the compilation cache."""
    findings = []
    if os.environ.get("JAX_ENABLE_X64", "0").lower() in {"1", "true"}:
        advice = "unset it; lgprjax is tested in float32"
        findings.append(InstallationFinding("JAX_ENABLE_X64", os.environ["JAX_ENABLE_X64"], "look", advice))
    cache = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if cache is not None:
        usable = os.access(cache, os.W_OK) if Path(cache).exists() else os.access(Path(cache).parent, os.W_OK)
        advice = "" if usable else "not writable: every command compiles its programs again"
        findings.append(InstallationFinding("JAX_COMPILATION_CACHE_DIR", cache, "good" if usable else "look", advice))
    return findings


# Whether this machine runs the onboard registration, for ``lgprjax doctor --onboard``.

_SPARE = 1.5
"""Required reserve of the search alone: control loop, recorder and simulated devices run at the same time."""


def look_at_onboard() -> list[InstallationFinding]:
    """Whether this machine registers 126 scans per second and keeps real time."""
    from lgprjax.simulation import real_time

    scans_hz = real_time.measure_search()
    found = f"{scans_hz:.0f} scans per second registered, {real_time.SCANS_HZ:.0f} required"
    if scans_hz >= _SPARE * real_time.SCANS_HZ:
        search = InstallationFinding("onboard registration", found, "good")
    else:
        least = (
            f"{_SPARE * real_time.SCANS_HZ:.0f} leave a reserve; a longer radar.scan_period_us reduces the scan rate"
        )
        search = InstallationFinding("onboard registration", found, "look", least)
    kept = real_time.measure_real_time()
    advice = "" if kept.keeps else "stop other programs; lgprjax run --simulate uses simulated time (lock step)"
    return [search, InstallationFinding("real time", kept.line, "good" if kept.keeps else "look", advice)]
