"""Does this machine do what lgprjax needs of it: device, arithmetic, memory, disk, projections, pictures?"""

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from shutil import disk_usage

import numpy as np

from lgprjax.cli.health_of_packages import Finding
from lgprjax.machine import usable_cores

_START_S = 120.0
_LEAST_MEMORY_GB, _LEAST_DISK_GB = 4.0, 2.0
# In a process of its own: a driver that hangs or crashes must not take the doctor with it.
_PROBE = """
import jax, jax.numpy as jnp, numpy as np
device = jax.devices()[0]
left = np.random.default_rng(0).normal(size=(256, 256)).astype(np.float32)
wrong = np.abs(np.asarray(jnp.asarray(left) @ jnp.asarray(left)) - left.astype(np.float64) @ left).max()
print(len(jax.devices()), device.platform, device.device_kind, wrong, sep="|")
"""
_LARGEST_ERROR = 0.05
"""Of a sum of 256 products about 1: float32 leaves 1e-4, TF32 and bfloat16 more."""


def look_at_machine() -> list[Finding]:
    """Everything that can be looked at without a file of the user's."""
    findings = [_device(), _cores(), _memory(), _disk(), _projection(), _picture(), _real_time()]
    return [*findings, *_environment()]


def _device() -> Finding:
    advice = "reinstall jax for this machine, or set JAX_PLATFORMS=cpu"
    try:
        done = subprocess.run([sys.executable, "-c", _PROBE], capture_output=True, text=True, timeout=_START_S)
    except subprocess.TimeoutExpired:
        return Finding("device", f"no answer in {_START_S:g} s", "bad", advice)
    lines = done.stdout.strip().splitlines()
    if done.returncode != 0 or not lines:
        said = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
        return Finding("device", said, "bad", advice)
    count, platform, kind, wrong = lines[-1].split("|")
    found = f"{count} {platform} ({kind})" if platform != kind else f"{count} {platform}"
    if float(wrong) > _LARGEST_ERROR:
        precision = "set JAX_DEFAULT_MATMUL_PRECISION=float32: products of this device are too coarse"
        return Finding("device", f"{found}, matrix product wrong by {float(wrong):.2g}", "look", precision)
    return Finding("device", found, "good")


def _cores() -> Finding:
    cores = usable_cores()
    if cores < 2:
        return Finding("cores", str(cores), "look", "lgprjax run wants two at least")
    return Finding("cores", str(cores), "good")


def _memory() -> Finding:
    if not hasattr(os, "sysconf") or "SC_PHYS_PAGES" not in os.sysconf_names:
        return Finding("memory", "not known", "absent")
    total_gb = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    if total_gb < _LEAST_MEMORY_GB:
        return Finding("memory", f"{total_gb:.1f} GB", "look", f"{_LEAST_MEMORY_GB:g} GB are little for maps of arrays")
    return Finding("memory", f"{total_gb:.1f} GB", "good")


def _disk() -> Finding:
    here = Path.cwd()
    free_gb = disk_usage(here).free / 1e9
    try:
        with tempfile.TemporaryFile(dir=here) as file:
            file.write(b"lgprjax")
    except OSError as error:
        return Finding("disk", f"{here}: {error.strerror}", "look", "outputs must be written elsewhere")
    if free_gb < _LEAST_DISK_GB:
        return Finding("disk", f"{free_gb:.1f} GB free", "look", "a drive of an array is 0.5 MB a second")
    return Finding("disk", f"{free_gb:.1f} GB free in this folder", "good")


def _projection() -> Finding:
    """Of the point where the equator meets the middle of UTM zone 31."""
    import pyproj

    advice = "unset PROJ_DATA and PROJ_LIB, or reinstall pyproj: its database belongs to another version"
    try:
        east, north = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32631", always_xy=True).transform(3.0, 0.0)
    except Exception as error:
        return Finding("projections", str(error), "bad", advice)
    if not np.allclose([east, north], [500000.0, 0.0], atol=1e-3):
        return Finding("projections", f"{east:.3f}, {north:.3f} for 500000, 0", "bad", advice)
    return Finding("projections", f"PROJ {pyproj.proj_version_str}", "good")


def _picture() -> Finding:
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib.figure import Figure

    try:
        with tempfile.TemporaryFile() as file:
            Figure().savefig(file)
    except Exception as error:
        return Finding("pictures", str(error), "bad", "reinstall matplotlib")
    return Finding("pictures", f"matplotlib {mpl.__version__}", "good")


def _real_time() -> Finding:
    """Only the onboard runtime asks for it."""
    if sys.platform != "linux":
        return Finding("real-time priority", "not on this system", "absent", "lgprjax run goes on without it")
    allowed = resource.getrlimit(resource.RLIMIT_RTPRIO)[1]
    if allowed == 0 and os.geteuid() != 0:
        advice = "for lgprjax run: LimitRTPRIO in the systemd unit, or rtprio in limits.conf"
        return Finding("real-time priority", "not permitted", "absent", advice)
    return Finding("real-time priority", "permitted", "good")


def _environment() -> list[Finding]:
    """Variables that change what JAX computes, or where it keeps what it has compiled."""
    findings = []
    if os.environ.get("JAX_ENABLE_X64", "0").lower() in {"1", "true"}:
        advice = "unset it: lgprjax is tested in float32"
        findings.append(Finding("JAX_ENABLE_X64", os.environ["JAX_ENABLE_X64"], "look", advice))
    cache = os.environ.get("JAX_COMPILATION_CACHE_DIR")
    if cache is not None:
        usable = os.access(cache, os.W_OK) if Path(cache).exists() else os.access(Path(cache).parent, os.W_OK)
        advice = "" if usable else "it cannot be written: everything is compiled anew each time"
        findings.append(Finding("JAX_COMPILATION_CACHE_DIR", cache, "good" if usable else "look", advice))
    return findings
