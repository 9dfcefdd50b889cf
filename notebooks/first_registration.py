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
# Two drives over the same road make a map. A third drive, on another day and with GNSS off by one metre, is located on it by its radar alone. A fourth drive, over other ground, must be rejected.

# %%
from pathlib import Path

BASELINES = ()  # your own drive logs, X.drive.h5, for the map
LIVE = ()  # your own drive logs to be located on it
OUTPUT = Path("../out/notebooks/first_registration")

# %% [markdown]
# If you have no drive logs, this cell simulates drives over a road of 70 m with a radar of 11 channels. The ground is random, from a seed. True positions are known, so errors can be computed.

# %%
import lgprjax as lx

if not BASELINES:
    logs = lx.simulate("village", OUTPUT, force=True)
    BASELINES = (logs["baseline_left"], logs["baseline_right"])
    LIVE = (logs["live"], logs["impostor"])
print(*(lx.open_drive(log) for log in (*BASELINES, *LIVE)), sep="\n")

# %% [markdown]
# The map stores the drives as stations at equal steps along the track, with the in-band radar signal of every channel. `lgprjax map build` makes the same map, and `lgprjax map verify` rates it.

# %%
site = lx.build_map(BASELINES, OUTPUT / "site.map.h5", force=True)
print(site)

# %% [markdown]
# Each scan is searched within 1.5 m of its GNSS position. A fix has a covariance and a code; **use only fixes with the code `ok` as positions.**

# %%
found = [lx.register(site, log, options=lx.RegisterOptions(search_m=1.5)) for log in LIVE]
for fixes in found:
    codes = fixes.table["code"].value_counts()
    print(f"{fixes.name}: " + ", ".join(f"{count} {code}" for code, count in codes.items()))

# %% [markdown]
# Accuracy of the first drive: cross-track error of the fixes, cross-track error of the GNSS positions, and the sigma of each fix.

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
# Single scans: point at a scan to read its values, step with n and p, and zoom with the wheel, with two fingers, or with + and −. (The picture needs scripts and is missing on GitHub.)

# %%
lx.zoom(live)

# %% [markdown]
# The drive over other ground: correlations stay at chance level, and no fix is `ok`. `lgprjax register MAP DRIVE... -o DIR` writes fixes, pictures and a report.

# %%
figure, axes = plt.subplots(figsize=(9, 2.6), layout="constrained")
for fixes in found:
    axes.hist(fixes.table["correlation"], bins=np.linspace(0, 1, 51), alpha=0.7, label=fixes.name)
axes.set(xlabel="correlation", ylabel="scans")
axes.legend()
print({fixes.name: int(fixes.ok.sum()) for fixes in found})
