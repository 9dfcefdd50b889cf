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
# # Encoder against potentiometer
#
# Standing still, the wheel is turned from right to left and back in half turns, with a pause at each. The servo's encoder begins at another count at every start; the potentiometer does not. The fit says how many counts a volt is, and how far the two directions lie apart: the play. The log needs encoder, potentiometer and odometry; pauses of a second or more.

# %%
from pathlib import Path

LOG = Path("../out/drives/standing.drive.h5")  # your own drive log
VEHICLE = Path("../tuning/tuned.vehicle.toml")  # your own vehicle file
OUTPUT = Path("../out/notebooks/encoder_potentiometer")

# %% [markdown]
# Without a log of your own, one is simulated.

# %%
import lgprjax as lx

if not LOG.exists():
    lx.simulate("../tuning/drives.toml", LOG.parent, only=[LOG.name.removesuffix(".drive.h5")])

# %% [markdown]
# Each pause is one point. A straight line is fitted unless the residuals demand more, and the result says which.

# %%
from lgprjax.formats import Study

study = Study(Path("encoder_potentiometer.ipynb"), "encoder_potentiometer", "encoder", VEHICLE, None, (LOG,), (), {})
tuned = lx.tune(study)
detail = tuned.finished.outcome.detail
for figure in tuned.finished.outcome.figures:
    print(f"{figure.name}: {figure.value:.3g} {figure.unit}")
for note in tuned.notes:
    print(note)

# %%
from IPython.display import Image

from lgprjax.report.study_pictures import draw_encoder

OUTPUT.mkdir(parents=True, exist_ok=True)
draw_encoder(detail.signals, detail.fit, detail.v_per_rad, OUTPUT / "encoder.png", force=True)
Image(OUTPUT / "encoder.png", width=560)

# %% [markdown]
# The vehicle file gets counts a volt. With `potentiometer_v_per_rad` in it, from a palm tree, it gets counts a radian and the play as an angle of the wheels, too.

# %%
vehicle = tuned.vehicle.save(OUTPUT / VEHICLE.name, force=True)
print("vehicle file:", OUTPUT.name + "/" + vehicle.path.name)
tuned.table[~tuned.table["number"].str.contains("[", regex=False)].round(5)
