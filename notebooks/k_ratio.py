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
# # k, the rear wheels' share of the front angle
#
# The curvature of a turn gives (1 + k) times the front angle and no more. What tells k is where the turn's centre lies along the body: the rear axle moves at minus the rear wheels' angle to the body, and INS heading against the path shows it. An INS that is mounted askew adds a constant, which left and right turns tell from k. The log needs positions, INS headings, odometry and the potentiometer, and turns to both sides.

# %%
from pathlib import Path

LOG = Path("../out/drives/palm_tree.drive.h5")  # your own drive log
VEHICLE = Path("../tuning/made_up.vehicle.toml")  # your own vehicle file
OUTPUT = Path("../out/notebooks/k_ratio")

# %% [markdown]
# Without a log of your own, a palm tree is simulated, with an INS mounted 0.4° askew.

# %%
import lgprjax as lx

if not LOG.exists():
    lx.simulate("../tuning/drives.toml", LOG.parent, only=[LOG.name.removesuffix(".drive.h5")])

# %%
from lgprjax.formats import Study

study = Study(Path("k_ratio.ipynb"), "k_ratio", "rear_ratio", VEHICLE, None, (LOG,), (), {"method": "heading"})
tuned = lx.tune(study)
detail = tuned.finished.outcome.detail
for figure in tuned.finished.outcome.figures:
    print(f"{figure.name}: {figure.value:.3g} {figure.unit}")
for note in tuned.notes:
    print(note)

# %%
from IPython.display import Image

from lgprjax.report.study_pictures import draw_rear_ratio_angles, draw_rear_ratio_heading

OUTPUT.mkdir(parents=True, exist_ok=True)
draw_rear_ratio_heading(detail.arcs, detail.chassis, detail.fit, OUTPUT / "heading.png", force=True)
Image(OUTPUT / "heading.png", width=560)

# %% [markdown]
# The same log measures both wheel angles: a second way to k, which must agree.

# %%
both = lx.tune(study._replace(options={"method": "wheel_angles"}))
angles = both.finished.outcome.detail
one, other = tuned.finished.outcome.found["steering.rear_ratio"], both.finished.outcome.found["steering.rear_ratio"]
print(f"by heading {one.low:.4f} to {one.high:.4f}, by wheel angles {other.low:.4f} to {other.high:.4f}")
draw_rear_ratio_angles(angles.front_rad, angles.rear_rad, angles.fit, OUTPUT / "angles.png", force=True)
Image(OUTPUT / "angles.png", width=560)

# %% [markdown]
# The vehicle file gets k by heading.

# %%
vehicle = tuned.vehicle.save(OUTPUT / VEHICLE.name, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
tuned.table[~tuned.table["number"].str.contains("[", regex=False)].round(5)
