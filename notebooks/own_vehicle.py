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
# # Your own vehicle: from calibration drives to a vehicle file
#
# Four questions, each of which needs the previous answers. What is the ratio of rear to front wheel angle? Which wheel angle belongs to a voltage of the potentiometer, and to a count of the servo's encoder? Which look-ahead should the autopilot use? Every measured number has a 95 % interval, and a log that does not identify a number is refused.

# %%
from pathlib import Path

VEHICLE = Path("../tuning/made_up.vehicle.toml")  # your own vehicle file: wheelbase, track, and guesses
TURNS = Path("../out/drives/palm_tree.drive.h5")  # arcs to both sides, with positions and INS headings
STRAIGHT = Path("../out/drives/straight.drive.h5")  # along a straight line
RISING = Path("../out/drives/turns.drive.h5")  # turns to both sides at rising speed
STANDING = Path("../out/drives/standing.drive.h5")  # the wheel turned at standstill, with pauses
STEPS = Path("../out/drives/steering.drive.h5")  # steps and a sweep of the steering command
OUTPUT = Path("../out/notebooks/own_vehicle")
FOUND = OUTPUT / VEHICLE.name  # the file that each step adds its numbers to
OUTPUT.mkdir(parents=True, exist_ok=True)

# %% [markdown]
# If you have no logs, this cell simulates a vehicle with an INS misalignment of 0.4° and a position noise of 2 cm; one position in a hundred is off by metres.

# %%
import lgprjax as lx

missing = [log for log in (TURNS, STRAIGHT, RISING, STANDING, STEPS) if not log.exists()]
if missing:
    names = [log.name.removesuffix(".drive.h5") for log in missing]
    lx.simulate("../tuning/drives.toml", missing[0].parent, only=names)

# %% [markdown]
# **k, the ratio of rear to front wheel angle.** The curvature of a turn gives only (1 + k) times the front angle. k follows from the position of the turn centre along the body: the course at the rear axle is the heading minus the rear wheel angle, and the INS heading against the path measures it. An INS misalignment adds a constant, which left and right turns separate from k.

# %%
from IPython.display import Image

turned = lx.tune("rear_ratio", vehicle=VEHICLE, logs=[TURNS], method="heading")
vehicle = turned.vehicle.save(FOUND, force=True)
Image(turned.draw(OUTPUT, force=True)["rear_ratio"], width=560)

# %% [markdown]
# This log contains both wheel angles as well: a second estimate of k, which must agree.

# %%
angles = lx.tune("rear_ratio", vehicle=VEHICLE, logs=[TURNS], method="wheel_angles")
for way, found in (("heading", turned), ("wheel angles", angles)):
    k = found.table.set_index("number").loc["steering.rear_ratio"]
    print(f"k by {way}: {k['low']:.4f} to {k['high']:.4f}")

# %% [markdown]
# **The palm tree.** Steer full left, drive an arc forward and back to the start, turn the steering wheel half a turn to the right, and repeat to full right. A circle is fitted to each stretch of constant steering; its curvature gives the front wheel angle. The straight-ahead voltage comes first.

# %%
straight = lx.tune("straight", vehicle=vehicle, logs=[STRAIGHT])
rough = lx.tune("wheel_angle", vehicle=straight.vehicle.save(FOUND, force=True), logs=[TURNS])
Image(rough.draw(OUTPUT, force=True)["palm_tree"], width=560)

# %% [markdown]
# Tyre slip takes half a per cent of the curvature at 1.5 m/s, which the map above attributed to the potentiometer. Turns at rising speed measure slip as the characteristic speed; then the palm tree is fitted again. The residuals of the map are arcs with errors, play, or a curve that a cubic does not describe.

# %%
slip = lx.tune("yaw_gain", vehicle=rough.vehicle.save(FOUND, force=True), logs=[RISING])
palm = lx.tune("wheel_angle", vehicle=slip.vehicle.save(FOUND, force=True), logs=[TURNS])
vehicle = palm.vehicle.save(FOUND, force=True)
for name, found in (("without slip", rough), ("with it", palm)):
    volts = found.table.set_index("number").loc["steering.potentiometer_v_per_rad"]
    print(f"{name}: {volts['low']:.3f} to {volts['high']:.3f} V/rad")
Image(palm.draw(OUTPUT, force=True)["wheel_angle"], width=560)

# %% [markdown]
# **The encoder.** Its count at power-on is arbitrary, that of the potentiometer is not. Each pause at standstill is a point. The difference between the two directions is the play.

# %%
encoder = lx.tune("encoder", vehicle=vehicle, logs=[STANDING])
vehicle = encoder.vehicle.save(FOUND, force=True)
print(*encoder.notes, sep="\n")
Image(encoder.draw(OUTPUT, force=True)["encoder"], width=560)

# %% [markdown]
# **The servo and the look-ahead.** A short look-ahead makes the vehicle weave, and a long one cuts corners. Lag and rate of the servo limit how short it may be. The fitted vehicle drives a course in simulation, and a gradient search finds the look-ahead with the least error and wheel movement, under the phase margin that lag and delay must leave.

# %%
servo = lx.tune("servo", vehicle=vehicle, logs=[STEPS])
course = {"courses": ["curve"], "speeds_mps": [2.235, 4.47], "arc_radius_m": 25.0, "duration_s": 25.0, "steps": 40}
tuned = lx.tune("look_ahead", vehicle=servo.vehicle.save(FOUND, force=True), **course)
Image(tuned.draw(OUTPUT, force=True)["look_ahead"], width=760)

# %% [markdown]
# All results. The look-ahead is chosen, not measured, so it has no interval.

# %%
import pandas as pd

vehicle = tuned.vehicle.save(FOUND, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
found = pd.concat([each.table for each in (turned, straight, slip, palm, encoder, servo, tuned)])
found[~found["number"].str.contains("[", regex=False)].set_index("number").round(4)
