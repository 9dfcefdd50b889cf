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
# # Re-registering an archive
#
# An archive of drives is registered on its map by worker processes. Then the map gets better, here because its baselines are made to agree with each other, and everything is registered anew: what do the drives gain?

# %%
from pathlib import Path

BASELINES = ()  # your own drive logs, X.drive.h5, for the map
DRIVES = ()  # your own drive logs to be located on it
OUTPUT = Path("../out/notebooks/archive")

# %% [markdown]
# Without logs of your own: three baselines of a made-up road of 25 m whose GNSS was wrong by some decimetres, each another way; three drives of other days, and one over other ground, which must stay without a fix.

# %%
import lgprjax as lx

SITE = """
name = "archive"
seed = 5
[ground]
length_m = 25
[navigation.gnss]
position_sigma_m = 0.35
heading_sigma_deg = 0.3
"""
KINDS = {"first": "", "second": "lane_m = 0.2", "third": "lane_m = -0.2", "clear": "", "snow": 'day = "snow"'}
KINDS |= {"years": 'day = "years"', "elsewhere": "other_ground = 99"}


OUTPUT.mkdir(parents=True, exist_ok=True)
if not BASELINES:
    drives = [f'[[drive]]\nname = "{name}"\nnavigation = "gnss"\n{more}\n' for name, more in KINDS.items()]
    (OUTPUT / "archive.toml").write_text(SITE + "".join(drives))
    logs = list(lx.simulate(OUTPUT / "archive.toml", OUTPUT, force=True).values())
    BASELINES, DRIVES = logs[:3], logs[3:]

# %% [markdown]
# The map as its labels have it, and all drives on it. A second call would find everything done and do nothing. `largest_m` is against the truth, so that it holds what the labels of the map are wrong by.

# %%
FIGURES = ["scans", "ok", "correlation_ok", "largest_m"]

as_labelled = lx.build_map(BASELINES, OUTPUT / "as_labelled.map.h5", force=True)
before = lx.register_many(as_labelled, DRIVES, OUTPUT / "before", workers=2).table.set_index("drive")
before[FIGURES]

# %% [markdown]
# Now the baselines are registered on each other, and their labels are moved until they agree.

# %%
agreed = as_labelled.refine(OUTPUT / "agreed.map.h5", force=True)
print(*agreed.notes, sep="\n")
agreed.table.round(3)

# %%
after = lx.register_many(agreed.map, DRIVES, OUTPUT / "after", workers=2).table.set_index("drive")
after[FIGURES]

# %% [markdown]
# What it was worth: ground that its baselines agree on is sharp, and drives match it better. Fixes are positions on the map: by how much all of its labels are wrong together no radar can tell, and `sigma_after_m` above says how large that may still be.

# %%
import matplotlib.pyplot as plt
import pandas as pd

correlation = pd.DataFrame({"before": before["correlation_ok"], "after": after["correlation_ok"]}).dropna()
figure, axes = plt.subplots(figsize=(9, 3), layout="constrained")
correlation.plot.barh(ax=axes, color=["0.7", "C0"])
axes.set(xlabel="median correlation of ok fixes", ylabel="", xlim=(0, 1))
axes.invert_yaxis()
print(pd.DataFrame({"ok before": before["ok"] / before["scans"], "ok after": after["ok"] / after["scans"]}).round(3))

# %% [markdown]
# `after/archive.html` has the map of the worst places, drive by drive. On a cluster the same: `scheduler=ADDRESS` instead of `workers`.
