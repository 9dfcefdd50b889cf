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
# # Your own radar
#
# From parallel survey lines of one antenna to a map, and to a later survey located on it. The example files are Sensors & Software `.DT1` with their `.HD`; GSSI, MALA, ImpulseRadar and SEG-Y files work the same way.

# %%
from pathlib import Path

MAP_LINES = ()  # your own lines, from left to right: the map
LIVE_LINES = ()  # lines of another day, to be located on it
SPACING_M = 0.127  # from line to line
OUTPUT = Path("../out/notebooks/own_radar")

# %% [markdown]
# If you have no files, this cell writes two simulated surveys of eleven lines, 50 m long, over the same ground. The second survey is of another day. It starts 40 cm farther on and 10 cm to the right, and its files do not record this offset.

# %%
import numpy as np

import lgprjax as lx
from lgprjax.formats import DriveLog

STEP_M, TRACES = 0.05, 1000


def write_lines(log, name, first_m):
    """Each channel of a drive as a line of its own: text header, and traces of 16 bits at equal steps."""
    way, radar = log.description.odometry, log.description.recording
    traces, _ = log.read_traces(0, log.scans)
    travel = np.interp(log.scan_time_s, way.time_s, way.distance_m)
    nearest = np.searchsorted(travel, travel[0] + first_m + STEP_M * np.arange(TRACES))
    paths = []
    for line in range(log.channels):
        paths.append(OUTPUT / f"{name}{line:02d}.DT1")
        records = np.zeros(TRACES, [("head", "<f4", 32), ("samples", "<i2", radar.samples)])
        records["head"][:, 1] = STEP_M * np.arange(TRACES)
        records["head"][:, 2], records["head"][:, 5] = radar.samples, 2
        records["samples"] = 100 * traces[nearest, line]
        paths[-1].write_bytes(records.tobytes())
        header = {
            "NUMBER OF TRACES": TRACES,
            "NUMBER OF PTS/TRC": radar.samples,
            "TIMEZERO AT POINT": radar.time_zero_ns / radar.sample_interval_ns,
            "TOTAL TIME WINDOW": radar.samples * radar.sample_interval_ns,
            "STEP SIZE USED": STEP_M,
            "POSITION UNITS": "m",
            "NOMINAL FREQUENCY": 250,
        }
        paths[-1].with_suffix(".HD").write_text("".join(f"{key:18} = {value}\n" for key, value in header.items()))
    return tuple(paths)


# %%
OUTPUT.mkdir(parents=True, exist_ok=True)
if not MAP_LINES:
    logs = lx.simulate("village", OUTPUT, only=["baseline_left", "live"], force=True)
    with DriveLog.open(logs["baseline_left"].path) as first, DriveLog.open(logs["live"].path) as second:
        MAP_LINES, LIVE_LINES = write_lines(first, "MAP", 5.4), write_lines(second, "DAY", 0.8)
print(len(MAP_LINES), "lines:", MAP_LINES[0].name, "to", MAP_LINES[-1].name)

# %% [markdown]
# One line, as the reader decodes it:

# %%
import matplotlib.pyplot as plt

figure, axes = plt.subplots(figsize=(9, 3), layout="constrained")
lx.view(MAP_LINES[5], ax=axes).set_ylim(55, 0)
plt.show()

# %% [markdown]
# The same line as a zoomable picture: use the wheel, two fingers, or + and −; point at a sample to read travel time and depth; set the contrast above the picture. `lgprjax view LINE.DT1 --html` writes the same page. (The picture needs scripts and is missing on GitHub.)

# %%
lx.zoom(MAP_LINES[5])

# %% [markdown]
# Parallel lines become a drive with many channels (`lgprjax import lines`). You give the geographic position of their origin.

# %%
from lgprjax.formats import import_lines

for name, paths in (("map", MAP_LINES), ("day", LIVE_LINES)):
    import_lines(paths, line_spacing_m=SPACING_M, output=OUTPUT / f"{name}.drive.h5", force=True)
    print(lx.check(OUTPUT / f"{name}.drive.h5"))

# %% [markdown]
# Build the map and locate the second survey on it. Both surveys claim the same origin; registration finds the true offset of the second.

# %%
site = lx.build_map(OUTPUT / "map.drive.h5", OUTPUT / "site.map.h5", force=True)
fixes = lx.register(site, OUTPUT / "day.drive.h5", options=lx.RegisterOptions(search_m=1.5))
ok, surveyed, pose = fixes.ok, fixes.result, np.asarray(fixes.fix.pose)
away = np.stack([pose[:, 0] - surveyed.prior_east_m, pose[:, 1] - surveyed.prior_north_m], axis=1)[ok]
print(
    f"{ok.sum()} of {len(ok)} traces ok; "
    f"off by {np.median(away[:, 0]):.2f} m along the lines, {np.median(away[:, 1]):.2f} m across"
)

# %%
figure, axes = plt.subplots(figsize=(9, 2.6), layout="constrained")
way_m = surveyed.distance_m[ok]
axes.plot(way_m, away[:, 0], ".", ms=2, label="along")
axes.plot(way_m, away[:, 1], ".", ms=2, label="across")
axes.set(xlabel="along the lines (m)", ylabel="fix less survey (m)", ylim=(-1, 1))
axes.legend()
plt.show()
