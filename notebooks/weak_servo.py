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
# # Detecting a weak servo
#
# The supply voltage is normal, but the servo has lost 30 % of its torque. Ordinary drives show the loss if the wheels turn near their rate limit. A gentle drive does not, and its result says so.

# %%
import lgprjax as lx

OUTPUT = "../out/notebooks/weak_servo"
VEHICLE = "../tuning/tracking.vehicle.toml"
drives = lx.simulate("../tuning/weak_drives.toml", f"{OUTPUT}/drives", force=True)

# %%
for names in (["gentle"], ["first", "second"]):
    loop = lx.tune("loop", vehicle=VEHICLE, logs=[drives[name] for name in names])
    print(", ".join(names), "-", next(note for note in loop.notes if note.startswith("torque")))

# %%
loop = lx.tune("loop", vehicle=VEHICLE, logs=[drives["first"], drives["second"]], held_out=[drives["held_out"]])
loop

# %% [markdown]
# The vehicle file with the weak servo. On board, the look-ahead grows automatically while the measured torque is below that of the file. With an updated file, this correction is not needed.

# %%
loop.vehicle.save(f"{OUTPUT}/tracking.vehicle.toml", force=True)
loop.table.round(3)
