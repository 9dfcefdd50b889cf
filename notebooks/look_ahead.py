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
# # The look-ahead over speed
#
# With a short look-ahead the vehicle weaves, with a long one it cuts corners. Here the vehicle of a file, with the servo that the other studies found, drives a course in simulation, from offsets of 0 and 3 m to both sides: straight on, a quarter turn, straight on (`courses` may name `line` and `arc`, too); the look-ahead of least error and least movement of the wheels is found by gradient, under the phase margin that lag and delay must leave. Put your own vehicle file in the next cell; a lower `supply_v` stands for a servo with less torque.

# %%
from pathlib import Path

VEHICLE = Path("../tuning/tuned.vehicle.toml")  # your own vehicle file
OPTIONS = {"courses": ["curve"], "speeds_mps": [2.235, 4.47], "arc_radius_m": 25.0, "duration_s": 25.0, "steps": 40}
OUTPUT = Path("../out/notebooks/look_ahead")

# %% [markdown]
# Half a minute: every step of every drive is differentiated.

# %%
import lgprjax as lx
from lgprjax.formats import Study

study = Study(Path("look_ahead.ipynb"), "look_ahead", "look_ahead", VEHICLE, None, (), (), OPTIONS)
tuned = lx.tune(study)
detail = tuned.finished.outcome.detail
for figure in tuned.finished.outcome.figures:
    print(f"{figure.name}: {figure.value:.3g} {figure.unit}")

# %%
from IPython.display import Image

from lgprjax.report.study_pictures import draw_look_ahead_sweep

OUTPUT.mkdir(parents=True, exist_ok=True)
draw_look_ahead_sweep(
    detail.tuned,
    detail.swept,
    detail.look_ahead_m,
    detail.speed_mps,
    detail.trials.least_margin_rad,
    OUTPUT / "look_ahead.png",
    force=True,
)
Image(OUTPUT / "look_ahead.png", width=760)

# %% [markdown]
# The vehicle file gets the four numbers of the look-ahead. They are chosen, not measured, and have no interval; those of the numbers behind them stay in the file.

# %%
vehicle = tuned.vehicle.save(OUTPUT / VEHICLE.name, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
tuned.table[["number", "value", "unit"]].round(3)
