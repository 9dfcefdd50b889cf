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
import lgprjax as lx

if not BASELINES:
    logs = lx.simulate("village", OUTPUT, force=True)
    BASELINES = (logs["baseline_left"], logs["baseline_right"])
    LIVE = (logs["live"], logs["impostor"])
print(*(lx.open_drive(log) for log in (*BASELINES, *LIVE)), sep="\n")

# %% [markdown]
# The map keeps the drives as stations at equal steps along the track, with the radar's signal of every channel in the band of its antennas. `lgprjax map build` does the same, `lgprjax map verify` says whether it can be trusted.

# %%
site = lx.build_map(BASELINES, OUTPUT / "site.map.h5", force=True)
print(site)

# %% [markdown]
# Every scan is searched for within 1.5 m of where GNSS believes the vehicle to be. A fix has a covariance and a code; **only `ok` is a position.**

# %%
found = [lx.register(site, log, options=lx.RegisterOptions(search_m=1.5)) for log in LIVE]
for fixes in found:
    codes = fixes.table["code"].value_counts()
    print(f"{fixes.name}: " + ", ".join(f"{count} {code}" for code, count in codes.items()))

# %% [markdown]
# What the fixes of the first drive are worth: their error across the track, beside that of the GNSS that they began from, and the sigma that each of them told.

# %%
import numpy as np

live = found[0]
way_m, ok = live.result.distance_m, live.ok


def across(east_m, north_m):
    east, north, yaw = live.truth[:, 0], live.truth[:, 1], live.truth[:, 3]
    return (north_m - north) * np.cos(yaw) - (east_m - east) * np.sin(yaw)


def rms_cm(error):
    return 100 * np.sqrt(np.mean(error**2))


pose = np.asarray(live.fix.pose)
error, believed = across(pose[:, 0], pose[:, 1]), across(live.result.prior_east_m, live.result.prior_north_m)
print(f"across, RMS: GNSS/INS {rms_cm(believed):.0f} cm, fixes {rms_cm(error[ok]):.1f} cm")

# %%
import matplotlib.pyplot as plt

sigma = live.table["sigma_cross_m"].to_numpy()
figure, axes = plt.subplots(figsize=(9, 3.2), layout="constrained")
axes.plot(way_m, 100 * believed, color="0.6", label="GNSS/INS")
axes.errorbar(
    way_m[ok][::20], 100 * error[ok][::20], 100 * sigma[ok][::20], fmt=".", color="C0", label="fix and its sigma"
)
axes.set(xlabel="along the drive (m)", ylabel="error across the track (cm)")
axes.legend()
plt.show()

# %% [markdown]
# Scan by scan: point at one to read its numbers, or step from scan to scan by n and p; zoom by the wheel, by two fingers, or by + and −. (Where notebooks are shown without scripts, as on GitHub, the picture is missing.)

# %%
lx.zoom(live)

# %% [markdown]
# The drive over other ground: correlations as high as chance makes them, and no fix is called `ok`. `lgprjax register MAP DRIVE... -o DIR` writes fixes, pictures and a report of all this.

# %%
figure, axes = plt.subplots(figsize=(9, 2.6), layout="constrained")
for fixes in found:
    axes.hist(fixes.table["correlation"], bins=np.linspace(0, 1, 51), alpha=0.7, label=fixes.name)
axes.set(xlabel="correlation", ylabel="scans")
axes.legend()
print({fixes.name: int(fixes.ok.sum()) for fixes in found})
