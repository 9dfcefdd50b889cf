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
# # The noises of the navigation filter
#
# A filter weighs its sources by their noises: too small, and it shuts out the truth; too large, and it follows every error. If they are right, innovations (what each source reads, less what the filter expected) are as large as the filter says and independent in time. Here the noises are found under which the innovations of logged drives are most likely, with 95 % intervals; what the drives do not tell stays as it was. A log needs GNSS/INS with its sigmas, odometry, a gyro, and beside it the fixes of its scans, `NAME.fixes.h5`, which `lgprjax register` writes. A hundred seconds of turns at changing speed are the least. k comes first (`k_ratio`): a vehicle file that is wrong about the rear wheels costs centimetres.

# %%
from pathlib import Path

LOGS = [Path(f"../out/drives/fusion_{number}.drive.h5") for number in (1, 2, 3, 4)]  # your own drive log, or several
HELD_OUT = [Path("../out/drives/fusion_held_out.drive.h5")]  # one that judges, or none: []
VEHICLE = Path("../tuning/made_up.vehicle.toml")  # your own vehicle file
OUTPUT = Path("../out/notebooks/fusion")

# %% [markdown]
# Without logs of your own, five drives of a minute are simulated. Their fixes are drawn from an error model of fixes, there is no radar in them. The gyro has a noise of 0.002 rad/s/√Hz and a bias that walks by 0.0002 rad/s/√s, GNSS wanders by 6 cm over 15 s against the map, and one position in a hundred is off by metres.

# %%
import lgprjax as lx

missing = [log for log in (*LOGS, *HELD_OUT) if not log.exists()]
if missing:
    names = [log.name.removesuffix(".drive.h5") for log in missing]
    lx.simulate("../tuning/drives.toml", missing[0].parent, only=names)

# %% [markdown]
# Half a minute, most of it compilation. The noises to begin with stand in the vehicle file and are rather too large: by them the filter's gates choose what is an outlier.

# %%
tuned = lx.tune("fusion", vehicle=VEHICLE, logs=LOGS, held_out=HELD_OUT)
print(*tuned.notes, sep="\n")
tuned.table.round(6)

# %%
from IPython.display import Image

Image(tuned.draw(OUTPUT, force=True)["innovations"], width=860)

# %% [markdown]
# The same in numbers. The mean normalised innovation squared (NIS) of a component is 1 where the noises are right: below, the filter believes a source too little, above, too much. It stays below 1 for fixes that say of themselves less than they know: their covariance is taken as it is, and so is that of GNSS. Errors need a truth in the log. The threshold switch goes by the fixes while they match well, else by GNSS/INS; the smoother has the whole drive at hand.

# %%
tuned.figures.round(3)

# %% [markdown]
# The vehicle file gets the noises found.

# %%
vehicle = tuned.vehicle.save(OUTPUT / VEHICLE.name, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
