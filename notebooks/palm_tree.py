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
from lgprjax.simulation import read_vehicle_plan, write_vehicle_logs

if not LOG.exists():
    drives = read_vehicle_plan("../tuning/drives.toml")
    write_vehicle_logs(drives, LOG.parent, only=[LOG.name.removesuffix(".drive.h5")])

# %% [markdown]
# Stretches of constant steering are found, a circle is fitted to each, and a cubic through the angles.

# %%
from lgprjax.formats import Study
from lgprjax.studies.steering import run_study

study = Study(Path("palm_tree.ipynb"), "palm_tree", "wheel_angle", VEHICLE, None, (LOG,), (), {})
finished = run_study(study)
detail = finished.outcome.detail
for figure in finished.outcome.figures:
    print(f"{figure.name}: {figure.value:.3g} {figure.unit}")
for note in finished.outcome.notes:
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
from lgprjax.formats import write_vehicle

OUTPUT.mkdir(parents=True, exist_ok=True)
write_vehicle(OUTPUT / VEHICLE.name, finished.vehicle, force=True)
for path, found in finished.vehicle.found.items():
    if found.study == study.name:
        value = finished.outcome.found[path]
        if not isinstance(value, list):
            print(f"{path}: {value.value:.5g}, 95 % interval {found.low:.5g} to {found.high:.5g}")
print("vehicle file:", OUTPUT.name + "/" + VEHICLE.name)
