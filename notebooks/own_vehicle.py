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
# # A vehicle of your own: from calibration drives to its file
#
# Four questions, in the order in which each needs the answer before it. How much of the steering do the rear wheels take? Which wheel angle belongs to the potentiometer's volts, and to the counts of the servo's encoder? How far ahead should the autopilot look? Every number that is measured comes with a 95 % interval, and a log that does not tell one is refused.

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
# Without logs of your own: a vehicle that does not exist, with an INS mounted 0.4° askew and positions with 2 cm of noise, one in a hundred of them wrong by metres.

# %%
import lgprjax as lx

missing = [log for log in (TURNS, STRAIGHT, RISING, STANDING, STEPS) if not log.exists()]
if missing:
    names = [log.name.removesuffix(".drive.h5") for log in missing]
    lx.simulate("../tuning/drives.toml", missing[0].parent, only=names)

# %% [markdown]
# **k, the rear wheels' share of the front angle.** The curvature of a turn gives (1 + k) times the front angle and no more. What tells k is where the turn's centre lies along the body: the rear axle moves at minus the rear wheels' angle to the body, and the INS heading against the path shows it. A mounting askew adds a constant, which left and right turns tell from k.

# %%
from IPython.display import Image

turned = lx.tune("rear_ratio", vehicle=VEHICLE, logs=[TURNS], method="heading")
vehicle = turned.vehicle.save(FOUND, force=True)
Image(turned.draw(OUTPUT, force=True)["rear_ratio"], width=560)

# %% [markdown]
# This log measures both wheel angles, too: a second way to k, which must agree.

# %%
angles = lx.tune("rear_ratio", vehicle=VEHICLE, logs=[TURNS], method="wheel_angles")
for way, found in (("heading", turned), ("wheel angles", angles)):
    k = found.table.set_index("number").loc["steering.rear_ratio"]
    print(f"k by {way}: {k['low']:.4f} to {k['high']:.4f}")

# %% [markdown]
# **The palm tree.** Full left, an arc forward, back to the start, half a turn of the steering wheel less, and so on to full right. A circle is fitted to each stretch of constant steering, and its curvature gives the front wheel angle. The volts of driving straight on come first.

# %%
straight = lx.tune("straight", vehicle=vehicle, logs=[STRAIGHT])
rough = lx.tune("wheel_angle", vehicle=straight.vehicle.save(FOUND, force=True), logs=[TURNS])
Image(rough.draw(OUTPUT, force=True)["palm_tree"], width=560)

# %% [markdown]
# Tyres slip: at 1.5 m/s that takes half a per cent of the curvature, which the map above mistook for the potentiometer's. Turns at rising speed tell how much, as the characteristic speed; then the palm tree is fitted again. What the map leaves is an arc that does not fit, play, or a bend that a cubic has not.

# %%
slip = lx.tune("yaw_gain", vehicle=rough.vehicle.save(FOUND, force=True), logs=[RISING])
palm = lx.tune("wheel_angle", vehicle=slip.vehicle.save(FOUND, force=True), logs=[TURNS])
vehicle = palm.vehicle.save(FOUND, force=True)
for name, found in (("without slip", rough), ("with it", palm)):
    volts = found.table.set_index("number").loc["steering.potentiometer_v_per_rad"]
    print(f"{name}: {volts['low']:.3f} to {volts['high']:.3f} V/rad")
Image(palm.draw(OUTPUT, force=True)["wheel_angle"], width=560)

# %% [markdown]
# **The encoder.** It begins at another count at every start; the potentiometer does not. Each pause at standstill is a point, and the two directions lie apart by the play.

# %%
encoder = lx.tune("encoder", vehicle=vehicle, logs=[STANDING])
vehicle = encoder.vehicle.save(FOUND, force=True)
print(*encoder.notes, sep="\n")
Image(encoder.draw(OUTPUT, force=True)["encoder"], width=560)

# %% [markdown]
# **The servo and the look-ahead.** With a short look-ahead the vehicle weaves, with a long one it cuts corners, and how short it may be depends on lag and rate of the servo. The vehicle found so far drives a course in simulation; the look-ahead of least error and least movement of the wheels is found by gradient, under the phase margin that lag and delay must leave.

# %%
servo = lx.tune("servo", vehicle=vehicle, logs=[STEPS])
course = {"courses": ["curve"], "speeds_mps": [2.235, 4.47], "arc_radius_m": 25.0, "duration_s": 25.0, "steps": 40}
tuned = lx.tune("look_ahead", vehicle=servo.vehicle.save(FOUND, force=True), **course)
Image(tuned.draw(OUTPUT, force=True)["look_ahead"], width=760)

# %% [markdown]
# All that was found. The look-ahead is chosen, not measured: it has no interval.

# %%
import pandas as pd

vehicle = tuned.vehicle.save(FOUND, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
found = pd.concat([each.table for each in (turned, straight, slip, palm, encoder, servo, tuned)])
found[~found["number"].str.contains("[", regex=False)].set_index("number").round(4)
