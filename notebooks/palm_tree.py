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
# # The palm tree: steering angle to wheel angle
#
# Full left, an arc forward, back to the start, half a turn less, and so on to full right. Each arc's curvature gives the front wheel angle that belongs to the potentiometer's value. Put the path of your own log in the next cell, and a vehicle file with the wheelbase, `rear_ratio` and, if you have it, the characteristic speed: at 1.5 m/s slip takes half a per cent of the curvature. The log needs positions, odometry and the potentiometer.

# %%
from pathlib import Path

LOG = Path("../out/drives/palm_tree.drive.h5")  # your own drive log
VEHICLE = Path("../tuning/tuned.vehicle.toml")  # your own vehicle file
OUTPUT = Path("../out/notebooks/palm_tree")

# %% [markdown]
# Without a log of your own, one is simulated: a vehicle that does not exist, fixes with 2 cm of noise, one in a hundred of them wrong by metres.

# %%
import lgprjax as lx

if not LOG.exists():
    lx.simulate("../tuning/drives.toml", LOG.parent, only=[LOG.name.removesuffix(".drive.h5")])

# %% [markdown]
# Stretches of constant steering are found, a circle is fitted to each, and a cubic through the angles.

# %%
from lgprjax.formats import Study

study = Study(Path("palm_tree.ipynb"), "palm_tree", "wheel_angle", VEHICLE, None, (LOG,), (), {})
tuned = lx.tune(study)
detail = tuned.finished.outcome.detail
for figure in tuned.finished.outcome.figures:
    print(f"{figure.name}: {figure.value:.3g} {figure.unit}")
for note in tuned.notes:
    print(note)

# %%
from IPython.display import Image

from lgprjax.report.study_pictures import draw_arcs, draw_wheel_angle

OUTPUT.mkdir(parents=True, exist_ok=True)
draw_arcs(detail.signals, detail.arcs, detail.fit, OUTPUT / "arcs.png", force=True)
Image(OUTPUT / "arcs.png", width=560)

# %% [markdown]
# Residuals show what the map leaves: an arc that does not fit, play, a bend that a cubic has not. The band is the 95 % interval of the map.

# %%
draw_wheel_angle(detail.fit, OUTPUT / "wheel_angle.png", force=True)
Image(OUTPUT / "wheel_angle.png", width=560)

# %% [markdown]
# The result is a vehicle file with the map and its intervals.

# %%
vehicle = tuned.vehicle.save(OUTPUT / VEHICLE.name, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
tuned.table[~tuned.table["number"].str.contains("[", regex=False)].round(5)
