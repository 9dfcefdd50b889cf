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
# # A weak servo found
#
# The supply reads as ever, and yet the servo has lost three tenths of its torque. Ordinary drives tell, if they turn the wheels near their rate; a gentle one does not, and says so.

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
# The file with the servo as it is now. On board the look-ahead grows by itself while the file's own servo is measured to be weaker than it says; a file that knows better needs no such help.

# %%
loop.vehicle.save(f"{OUTPUT}/tracking.vehicle.toml", force=True)
loop.table.round(3)
