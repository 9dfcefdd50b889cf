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
# # What logs identify
#
# A drive does not identify every number. A gentle drive does not show the rate of the servo; a manual drive, without commands, does not show the servo at all. Numbers that a log leaves open are listed, and the vehicle file keeps its values.

# %%
import lgprjax as lx

OUTPUT = "../out/notebooks/what_logs_tell"
VEHICLE = "../tuning/tracking.vehicle.toml"
drives = lx.simulate("../tuning/tracking_drives.toml", f"{OUTPUT}/drives", force=True)

# %% [markdown]
# A gentle drive along wide bends.

# %%
gentle = lx.tune("loop", vehicle=VEHICLE, logs=[drives["gentle"]])
print(*gentle.notes, sep="\n")
gentle

# %% [markdown]
# Two drives that were engaged three metres off the path: the wheels turn at their rate limit.

# %%
brisk = lx.tune("loop", vehicle=VEHICLE, logs=[drives["first"], drives["second"]])
print(*brisk.notes, sep="\n")
brisk.table.round(3)

# %% [markdown]
# Unsuitable logs are refused with the reason: here a straight manual drive for a servo study, and a drive without standstill for an encoder study.

# %%
straight = lx.simulate("../tuning/drives.toml", f"{OUTPUT}/drives", only=["straight"], force=True)["straight"]
for kind in ("servo", "loop", "encoder", "yaw_gain"):
    try:
        lx.tune(kind, vehicle=VEHICLE, logs=[straight])
    except ValueError as error:
        print(f"{kind}:", str(error).partition("straight.drive.h5: ")[2])
