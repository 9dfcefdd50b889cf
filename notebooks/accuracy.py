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
# # Accuracy and reliability of fixes
#
# This notebook measures the errors of fixes, what reduces them, whether sigmas match the errors, and the probability of false matches. It needs drives with known positions: simulated ones, or your own with survey-grade positions in `truth`.

# %%
from pathlib import Path

BASELINES = ()  # your own drive logs, X.drive.h5, for the map
LIVE = None  # your own drive log to be located on it, with truth
FOREIGN = None  # one over other ground
OUTPUT = Path("../out/notebooks/accuracy")

# %% [markdown]
# If you have no drive logs, this cell simulates a road of 70 m, as in `first_registration`.

# %%
import lgprjax as lx

if not BASELINES:
    logs = lx.simulate("village", OUTPUT, force=True)
    BASELINES = (logs["baseline_left"], logs["baseline_right"])
    LIVE, FOREIGN = logs["live"], logs["impostor"]

# %% [markdown]
# **Overlap with the map.** The baselines are 0.3 m to each side of the lane's centre, and the live drive is 0.2 m to the left of it. Most of the array overlaps the left baseline, and less of it the right one.

# %%
sites = {"left": BASELINES[:1], "right": BASELINES[1:], "both": BASELINES}
fixes = {}
for name, drives in sites.items():
    site = lx.build_map(drives, OUTPUT / f"{name}.map.h5", force=True)
    fixes[name] = lx.register(site, LIVE)
    print(fixes[name])

# %%
import numpy as np
import pandas as pd


def errors_m(found):
    """Along and across the true track, of every scan."""
    pose, yaw = np.asarray(found.fix.pose), found.truth[:, 3]
    east, north = (pose[:, :2] - found.truth[:, :2]).T
    return east * np.cos(yaw) + north * np.sin(yaw), north * np.cos(yaw) - east * np.sin(yaw)


rows = {}
for name, found in fixes.items():
    along, across = (1000 * error[found.ok] for error in errors_m(found))
    rows[name] = {"ok (%)": 100 * found.ok.mean(), "along, RMS (mm)": np.sqrt(np.mean(along**2))}
    rows[name] |= {"across, RMS (mm)": np.sqrt(np.mean(across**2)), "across, mean (mm)": across.mean()}
pd.DataFrame(rows).T.rename_axis("map of").round(1)

# %% [markdown]
# An error common to all fixes is an error of the map: the positions of its baselines were off by centimetres, and a match cannot detect this. `lgprjax map refine` makes baselines agree with each other.
#
# **Calibration of sigmas.** Each error is divided by the sigma of its fix. If sigmas are correct, 68 % of the ratios are within one and 95 % within two; the curve is the normal distribution.

# %%
import matplotlib.pyplot as plt

both = fixes["both"]
told = both.table[["sigma_along_m", "sigma_cross_m"]].to_numpy()
figure, axes = plt.subplots(1, 2, figsize=(9, 3), layout="constrained", sharey=True)
at = np.linspace(-4, 4, 161)
for side, error, sigma, name in zip(axes, errors_m(both), told.T, ("along", "across"), strict=True):
    z = (error / sigma)[both.ok]
    side.hist(z, bins=np.linspace(-4, 4, 33), density=True, color="C0", alpha=0.7)
    side.plot(at, np.exp(-0.5 * at**2) / np.sqrt(2 * np.pi), color="k")
    side.set(xlabel=f"error {name} / sigma", title=f"{100 * np.mean(np.abs(z) < 2):.0f} % within two sigma")

# %% [markdown]
# **Probability of a false match.** `p_false` is the probability that ground from another place would have passed the complete search. Each fix uses a single scan, or the shortest window of travel that keeps `p_false` within the accepted risk. The ground of the foreign drive never reaches it.

# %%
foreign = lx.register(OUTPUT / "both.map.h5", FOREIGN)
figure, axes = plt.subplots(figsize=(9, 3), layout="constrained")
for found, colour in ((both, "C0"), (foreign, "C3")):
    p = np.maximum(found.table["p_false"], 1e-30)
    axes.semilogy(found.result.distance_m, p, ".", ms=3, color=colour, label=f"{found.name}: {found.ok.sum()} ok")
axes.axhline(lx.RegisterOptions().risk, color="k", ls="--", label="accepted risk")
axes.set(xlabel="along the drive (m)", ylabel="p_false")
figure.legend(loc="outside upper center", ncols=3)
plt.show()

# %% [markdown]
# Window lengths of the fixes, and the errors for longer windows. A window averages errors that are independent between scans. It does not reduce errors of the map.

# %%
bins = pd.cut(both.table["window_m"], [-0.01, 0.01, 1.5, 3, 6, 12], labels=["scan", "1 m", "2 m", "4 m", "8 m"])
along, across = (pd.Series(1000 * error) for error in errors_m(both))
squares = pd.DataFrame({"along": along**2, "across": across**2, "ok": both.ok})[both.ok]
table = squares.groupby(bins[both.ok], observed=True).agg({"along": "mean", "across": "mean", "ok": "size"})
table[["along", "across"]] = np.sqrt(table[["along", "across"]])
table.rename(columns={"along": "along, RMS (mm)", "across": "across, RMS (mm)", "ok": "scans"}).round(1)
