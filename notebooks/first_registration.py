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
# # A first registration
#
# Two drives over the same road are a map. A third drive, on another day and with GNSS wrong by a metre, is located against it by its radar alone; a fourth, over other ground, must be refused.

# %%
from pathlib import Path

BASELINES = ()  # your own drive logs, X.drive.h5, for the map
LIVE = ()  # your own drive logs to be located on it
OUTPUT = Path("../out/notebooks/first_registration")

# %% [markdown]
# Without logs of your own: drives over a made-up road of 70 m. The ground is drawn from a seed and seen by a radar of 11 channels; its true places are known, so that errors can be told.

# %%
from lgprjax.simulation import demo_site, write_drives

OUTPUT.mkdir(parents=True, exist_ok=True)
if not BASELINES:
    logs = write_drives(demo_site(), OUTPUT, force=True)
    BASELINES = (logs["baseline_left"], logs["baseline_right"])
    LIVE = (logs["live"], logs["impostor"])
print(*(path.name for path in (*BASELINES, *LIVE)), sep="\n")

# %% [markdown]
# The map keeps the drives as stations at equal steps along the track, with the radar's signal of every channel in the band of its antennas. `lgprjax map build` does the same, `lgprjax map verify` says whether it can be trusted.

# %%
from lgprjax.mapping import build_map

ground = build_map(BASELINES, OUTPUT / "site.map.h5", force=True)
low, high = ground.settings.band_low_hz / 1e6, ground.settings.band_high_hz / 1e6
step_cm = 100 * ground.settings.step_m
print(f"{ground.channels} channels, stations every {step_cm:.1f} cm, {low:.0f} to {high:.0f} MHz")

# %% [markdown]
# Every scan is searched for within 1.5 m of where GNSS believes the vehicle to be. A fix has a covariance and a code; **only `ok` is a position.**

# %%
from lgprjax.batch import register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.registration import RegisterOptions

options = RegisterOptions(search_m=1.5)
drives = {}
with MapFile.open(OUTPUT / "site.map.h5") as source:
    for path in LIVE:
        with DriveLog.open(path) as log:
            drives[path.name.removesuffix(".drive.h5")] = register_log(source, log, options)
for name, drive in drives.items():
    codes = drive.table["code"].value_counts()
    print(f"{name}: " + ", ".join(f"{count} {code}" for code, count in codes.items()))

# %% [markdown]
# What the fixes of the first drive are worth: their error across the track, beside that of the GNSS that they began from, and the sigma that each of them told.

# %%
import matplotlib.pyplot as plt
import numpy as np

drive = next(iter(drives.values()))
ok = drive.table["code"].to_numpy() == "ok"
way_m = drive.track.travel_m - drive.track.travel_m[0]


def across(pose):
    away, yaw = pose[:, :2] - drive.truth[:, :2], drive.truth[:, 3]
    return away[:, 1] * np.cos(yaw) - away[:, 0] * np.sin(yaw)


def rms_cm(error):
    return 100 * np.sqrt(np.mean(error**2))


found, believed = across(np.asarray(drive.fix.pose)), across(drive.track.pose)
sigma = drive.table["sigma_cross_m"].to_numpy()
figure, axes = plt.subplots(figsize=(9, 3.2), layout="constrained")
axes.plot(way_m, 100 * believed, color="0.6", label="GNSS/INS")
axes.errorbar(
    way_m[ok][::20], 100 * found[ok][::20], 100 * sigma[ok][::20], fmt=".", color="C0", label="fix and its sigma"
)
axes.set(xlabel="along the drive (m)", ylabel="error across the track (cm)")
axes.legend()
print(f"across, RMS: GNSS/INS {rms_cm(believed):.0f} cm, fixes {rms_cm(found[ok]):.1f} cm")

# %% [markdown]
# The drive over other ground: correlations as high as chance makes them, and no fix is called `ok`. `lgprjax register MAP DRIVE... -o DIR` writes fixes, pictures and a report of all this.

# %%
figure, axes = plt.subplots(figsize=(9, 2.6), layout="constrained")
for name, drive in drives.items():
    axes.hist(drive.table["correlation"], bins=np.linspace(0, 1, 51), alpha=0.7, label=name)
axes.set(xlabel="correlation", ylabel="scans")
axes.legend()
print({name: int((drive.table["code"] == "ok").sum()) for name, drive in drives.items()})
