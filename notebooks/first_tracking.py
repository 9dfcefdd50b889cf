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
# The autopilot has driven two courses with a cautious look-ahead, engaged three metres beside the path. How well did it follow; what do the logs tell of servo and chassis; which look-ahead would be better? Put your own drive logs, with the fixes of `lgprjax register` beside them, or folders of recorded runs, in the next cell.

# %%
import lgprjax as lx

OUTPUT = "../out/notebooks/first_tracking"
VEHICLE = "../tuning/tracking.vehicle.toml"  # the file that the vehicle drove by
drives = lx.simulate("../tuning/tracking_drives.toml", f"{OUTPUT}/drives", force=True)
logs = [drives["first"], drives["second"]]

# %% [markdown]
# Offsets by fixes that are smoothed back and forth; who steered is told apart.

# %%
tracking = lx.tune("tracking", vehicle=VEHICLE, logs=logs)
tracking

# %% [markdown]
# The loop: servo, rear ratio and slip from the same drives. A drive that took no part judges: the rollout of what was found is laid beside it, and were it contradicted, this cell would say so instead of giving numbers.

# %%
loop = lx.tune("loop", vehicle=VEHICLE, logs=logs, held_out=[drives["held_out"]])
loop.table.round(3)

# %%
loop

# %% [markdown]
# The look-ahead, for all vehicles that the logs allow, at full torque and at less of it. The file gets the schedule and how it grows for a servo that weakens.

# %%
known = loop.vehicle.save(f"{OUTPUT}/tracking.vehicle.toml", force=True)
tuned = lx.tune("look_ahead", vehicle=known, logs=logs, draws=256, courses=["line"])
tuned

# %%
tuned.vehicle.save(f"{OUTPUT}/tracking.vehicle.toml", force=True)
tuned.table[["number", "value", "unit"]].round(3)
