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
# From the files of one antenna that was drawn along parallel lines to a map, and to a later survey located on it. The files here are Sensors & Software `.DT1` with their `.HD`; GSSI, MALA, ImpulseRadar and SEG-Y go the same way.

# %%
from pathlib import Path

MAP_LINES = ()  # your own lines, from left to right: the map
LIVE_LINES = ()  # lines of another day, to be located on it
SPACING_M = 0.127  # from line to line
OUTPUT = Path("../out/notebooks/own_radar")

# %% [markdown]
# Without files of your own this cell writes some: two surveys of eleven lines, 50 m long, over the same made-up ground. The second, on another day, was begun 40 cm farther on and 10 cm to the right, which nobody noted down.

# %%
import numpy as np

from lgprjax.formats import DriveLog
from lgprjax.simulation import demo_site, write_drives

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
        records["head"][:, 1], records["head"][:, 2], records["head"][:, 5] = (
            STEP_M * np.arange(TRACES),
            radar.samples,
            2,
        )
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


OUTPUT.mkdir(parents=True, exist_ok=True)
if not MAP_LINES:
    logs = write_drives(demo_site(), OUTPUT, force=True)
    with DriveLog.open(logs["baseline_left"]) as first, DriveLog.open(logs["live"]) as second:
        MAP_LINES, LIVE_LINES = write_lines(first, "MAP", 5.4), write_lines(second, "DAY", 0.8)
print(len(MAP_LINES), "lines:", MAP_LINES[0].name, "to", MAP_LINES[-1].name)

# %% [markdown]
# What a reader makes of one of them:

# %%
import matplotlib.pyplot as plt

from lgprjax.formats import read_dt1

line = read_dt1(MAP_LINES[5])
section = line.channels[:, 0].astype(float)
section -= section.mean(axis=0)
limit = np.percentile(np.abs(section), 99)
time_ns = np.array([0, section.shape[1]]) * line.sample_interval_ns - line.time_zero_ns
figure, axes = plt.subplots(figsize=(9, 3), layout="constrained")
extent = (line.positions_m[0], line.positions_m[-1], time_ns[1], time_ns[0])
axes.imshow(section.T, cmap="gray", vmin=-limit, vmax=limit, extent=extent, aspect="auto")
axes.set(
    xlabel="along the line (m)", ylabel="two-way travel time (ns)", title="line 5, mean trace removed", ylim=(55, 0)
)
plt.show()

# %% [markdown]
# Lines side by side are a drive of many channels (`lgprjax import lines`). Its place on earth is that of the lines' origin, wherever you say that it is.

# %%
from lgprjax.formats import check_file, import_lines

for name, paths in (("map", MAP_LINES), ("day", LIVE_LINES)):
    import_lines(paths, line_spacing_m=SPACING_M, output=OUTPUT / f"{name}.drive.h5", force=True)
    print(name, check_file(OUTPUT / f"{name}.drive.h5") or "as the schema says")

# %% [markdown]
# The map, and the second survey on it. Both surveys claim to begin at the origin; how much the second is off is what the ground says.

# %%
from lgprjax.batch import register_log
from lgprjax.formats import MapFile
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions

build_map([OUTPUT / "map.drive.h5"], OUTPUT / "site.map.h5", force=True)
with MapFile.open(OUTPUT / "site.map.h5") as source, DriveLog.open(OUTPUT / "day.drive.h5") as log:
    drive = register_log(source, log, RegisterOptions(search_m=1.5))
ok = drive.table["code"].to_numpy() == "ok"
away = (np.asarray(drive.fix.pose) - drive.track.pose)[ok, :2]
print(
    f"{ok.sum()} of {len(ok)} traces ok; "
    f"off by {np.median(away[:, 0]):.2f} m along the lines, {np.median(away[:, 1]):.2f} m across"
)

# %%
figure, axes = plt.subplots(figsize=(9, 2.6), layout="constrained")
way_m = drive.track.travel_m[ok] - drive.track.travel_m[0]
axes.plot(way_m, away[:, 0], ".", ms=2, label="along")
axes.plot(way_m, away[:, 1], ".", ms=2, label="across")
axes.set(xlabel="along the lines (m)", ylabel="fix less survey (m)", ylim=(-1, 1))
axes.legend()
plt.show()
