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
# # From the first tracking log to a tuned vehicle file
#
# The autopilot has driven two courses with a cautious look-ahead, starting three metres off the path. How accurate was the tracking? What do the logs show about servo and chassis? Which look-ahead is better? In the next cell, enter your own drive logs (with the fixes of `lgprjax register` in the same folder) or folders of recorded runs.

# %%
import lgprjax as lx

OUTPUT = "../out/notebooks/first_tracking"
VEHICLE = "../tuning/tracking.vehicle.toml"  # the file that the vehicle drove by
drives = lx.simulate("../tuning/tracking_drives.toml", f"{OUTPUT}/drives", force=True)
logs = [drives["first"], drives["second"]]

# %% [markdown]
# Path offsets from smoothed fixes, separate for autopilot and driver.

# %%
tracking = lx.tune("tracking", vehicle=VEHICLE, logs=logs)
tracking

# %% [markdown]
# The loop: servo, rear ratio and slip from the same drives. A held-out drive tests the result: its rollout is plotted with the log. If it contradicts the result, the cell reports the contradiction and no numbers.

# %%
loop = lx.tune("loop", vehicle=VEHICLE, logs=logs, held_out=[drives["held_out"]])
loop.table.round(3)

# %%
loop

# %% [markdown]
# The look-ahead, for all vehicles that are consistent with the logs, at full and at reduced torque. The vehicle file gets the schedule and its dependence on torque.

# %%
known = loop.vehicle.save(f"{OUTPUT}/tracking.vehicle.toml", force=True)
tuned = lx.tune("look_ahead", vehicle=known, logs=logs, draws=256, courses=["line"])
tuned

# %%
tuned.vehicle.save(f"{OUTPUT}/tracking.vehicle.toml", force=True)
tuned.table[["number", "value", "unit"]].round(3)
