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
# A filter weights its sources by their noises. If a noise is too small, the filter rejects correct data; if it is too large, the filter follows errors. With correct noises, innovations (measurement minus prediction) have the predicted size and are independent in time. This study finds the noises with the highest likelihood of the innovations in logged drives, with 95 % intervals. Noises that the drives do not identify stay unchanged. A log needs GNSS/INS with sigmas, odometry, a gyro, and, next to it, the fixes `NAME.fixes.h5` from `lgprjax register`. At least a hundred seconds of turns at changing speed are needed. Fit k first (`k_ratio`): a wrong rear ratio causes errors of centimetres.

# %%
from pathlib import Path

LOGS = [Path(f"../out/drives/fusion_{number}.drive.h5") for number in (1, 2, 3, 4)]  # your own drive log, or several
HELD_OUT = [Path("../out/drives/fusion_held_out.drive.h5")]  # one that judges, or none: []
VEHICLE = Path("../tuning/made_up.vehicle.toml")  # your own vehicle file
OUTPUT = Path("../out/notebooks/fusion")

# %% [markdown]
# If you have no logs, this cell simulates five drives of one minute. Their fixes come from an error model of fixes, without radar. The gyro has a noise of 0.002 rad/s/√Hz and a bias walk of 0.0002 rad/s/√s. GNSS wanders by 6 cm over 15 s relative to the map, and one position in a hundred is off by metres.

# %%
import lgprjax as lx

missing = [log for log in (*LOGS, *HELD_OUT) if not log.exists()]
if missing:
    names = [log.name.removesuffix(".drive.h5") for log in missing]
    lx.simulate("../tuning/drives.toml", missing[0].parent, only=names)

# %% [markdown]
# This cell takes half a minute, mostly compilation. The initial noises are those of the vehicle file. They are larger than expected, because the filter's gates use them to reject outliers.

# %%
tuned = lx.tune("fusion", vehicle=VEHICLE, logs=LOGS, held_out=HELD_OUT)
print(*tuned.notes, sep="\n")
tuned.table.round(6)

# %%
from IPython.display import Image

Image(tuned.draw(OUTPUT, force=True)["innovations"], width=860)

# %% [markdown]
# The same as numbers. The mean normalised innovation squared (NIS) of a component is 1 if the noises are correct. Below 1, the filter trusts a source too little; above 1, too much. It stays below 1 for sources with conservative covariances, since the covariances of fixes and GNSS are used as they are. Errors need a truth in the log. The threshold switch uses fixes while they match well, else GNSS/INS; the smoother uses the complete drive.

# %%
tuned.figures.round(3)

# %% [markdown]
# Write the estimated noises to the vehicle file.

# %%
vehicle = tuned.vehicle.save(OUTPUT / VEHICLE.name, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
