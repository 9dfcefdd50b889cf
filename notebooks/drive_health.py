# ---
# jupyter:
#   jupytext:
#     formats: ipynb,py:percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---

# %% [markdown]
# # The health of a drive
#
# Check the quality of a recording before you build a map from it. Every figure has two limits: *look* and *bad*. `lgprjax check --health` prints the same figures.

# %%
from pathlib import Path

DRIVES = ()  # your own drive logs, X.drive.h5
OUTPUT = Path("../out/notebooks/drive_health")

# %% [markdown]
# If you have no drive logs, this cell simulates a good drive, and the same drive with common faults: a loose antenna cable, 40 lost scans, and an odometer with a scale error of 4 %.

# %%
import h5py
import numpy as np

import lgprjax as lx

if not DRIVES:
    drive = lx.simulate("village", OUTPUT, only=["baseline_left"], force=True)["baseline_left"]
    sound = drive.path.replace(OUTPUT / "sound.drive.h5")
    faulty = OUTPUT / "faulty.drive.h5"
    faulty.write_bytes(sound.read_bytes())
    with h5py.File(faulty, "r+") as log:
        traces = log["radar/traces"]
        quiet = np.random.default_rng(1).integers(126, 131, traces[:, 7].shape)
        traces[:, 7] = quiet.astype(traces.dtype)
        kept = np.setdiff1d(np.arange(len(traces)), np.arange(900, 940))
        for name in ("traces", "time_s", "valid"):
            if name in log["radar"]:
                values = log["radar"][name][()][kept]
                log["radar"][name].resize(len(kept), axis=0)
                log["radar"][name][...] = values
        log["odometry/distance_m"][...] *= 1.04
    DRIVES = (sound, faulty)
print(*(path.name for path in DRIVES))

# %% [markdown]
# Result of the check for each drive:

# %%
health = {path.name.removesuffix(".drive.h5"): lx.check(path, health=True).health for path in map(Path, DRIVES)}
for name, found in health.items():
    print(f"{name}: {found.scans} scans, {found.travel_m:.0f} m: {found.verdict}")

# %% [markdown]
# All figures, relative to the limit at which they are bad. Values beyond the dashed line spoil a map.

# %%
import matplotlib.pyplot as plt


def share(entry):
    """Of the bad limit; where small values are the bad ones the limit is divided by the value."""
    return entry.bad / max(entry.value, 1e-9) if entry.bad < entry.look else entry.value / entry.bad


figure, axes = plt.subplots(figsize=(9, 6), layout="constrained")
names = [entry.name for entry in next(iter(health.values())).figures]
for number, (name, found) in enumerate(health.items()):
    entries = [entry for entry in found.figures if entry.name in names]
    at = [names.index(entry.name) + 0.38 * number for entry in entries]
    axes.barh(at, np.clip(np.nan_to_num([share(entry) for entry in entries]), 0, 2), height=0.36, label=name)
axes.axvline(1.0, color="k", ls="--")
axes.set_yticks(np.arange(len(names)) + 0.19, names)
axes.set(xlabel="share of the limit", xlim=(0, 2))
axes.invert_yaxis()
axes.legend()
plt.show()

# %% [markdown]
# The findings in words, and their places along the drive:

# %%
for name, found in health.items():
    for entry in found.figures:
        if entry.verdict != "good":
            where = ", ".join(f"{stretch.start_m:.0f} to {stretch.stop_m:.0f} m" for stretch in entry.where[:2])
            print(
                f"{name}: {entry.verdict}: {entry.name} {entry.value:.3g} {entry.unit} ({where})\n    {entry.meaning}"
            )
