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
# # What my logs can tell
#
# Not every drive shows every number. A gentle drive says nothing of how fast the servo can turn; a drive by hand, without commands, says nothing of the servo at all. What a log leaves open is named, and the vehicle file keeps its value.

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
# Two drives that were engaged three metres beside the path: the wheels turn as fast as they can.

# %%
brisk = lx.tune("loop", vehicle=VEHICLE, logs=[drives["first"], drives["second"]])
print(*brisk.notes, sep="\n")
brisk.table.round(3)

# %% [markdown]
# A wrong kind of log is refused, with the reason: here a study of the servo is given a straight line driven by hand, and one of the encoder a drive that never stands.

# %%
straight = lx.simulate("../tuning/drives.toml", f"{OUTPUT}/drives", only=["straight"], force=True)["straight"]
for kind in ("servo", "loop", "encoder", "yaw_gain"):
    try:
        lx.tune(kind, vehicle=VEHICLE, logs=[straight])
    except ValueError as error:
        print(f"{kind}:", str(error).partition("straight.drive.h5: ")[2])
