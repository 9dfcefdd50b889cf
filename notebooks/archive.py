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
# Worker processes register an archive of drives on its map. Then the baselines of the map are aligned with each other, and all drives are registered again. How much do the fixes improve?

# %%
from pathlib import Path

BASELINES = ()  # your own drive logs, X.drive.h5, for the map
DRIVES = ()  # your own drive logs to be located on it
OUTPUT = Path("../out/notebooks/archive")

# %% [markdown]
# If you have no drive logs, this cell simulates three baselines of a road of 25 m with different GNSS errors of some decimetres, three drives of other days, and one drive over other ground, which must get no fix.

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
# Build the map with the positions as recorded, and register all drives. A second call finds all results complete and does nothing. `largest_m` is the error against the truth, so it includes the position errors of the map.

# %%
FIGURES = ["scans", "ok", "correlation_ok", "largest_m"]

as_labelled = lx.build_map(BASELINES, OUTPUT / "as_labelled.map.h5", force=True)
before = lx.register_many(as_labelled, DRIVES, OUTPUT / "before", workers=2).table.set_index("drive")
before[FIGURES]

# %% [markdown]
# Register the baselines on each other and correct their positions until they agree.

# %%
agreed = as_labelled.refine(OUTPUT / "agreed.map.h5", force=True)
print(*agreed.notes, sep="\n")
agreed.table.round(3)

# %%
after = lx.register_many(agreed.map, DRIVES, OUTPUT / "after", workers=2).table.set_index("drive")
after[FIGURES]

# %% [markdown]
# The improvement: ground from consistent baselines is sharp, and drives match it better. Fixes are positions in the map's frame. Radar cannot measure the common error of all baselines; `sigma_after_m` above gives its size.

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
# `after/archive.html` has a map of the worst places, by drive. For a cluster, use `scheduler=ADDRESS` instead of `workers`.
