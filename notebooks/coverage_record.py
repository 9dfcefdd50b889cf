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
# # The record of a worked field
#
# From three corners to a plan, from a recorded run to a map of the worked area, and to the files for handover. A record states *processed*, *uncertain* or *not processed* at a confidence level. A machine pass is not clearance: nothing here states that ground is free of hazards.

# %%
from pathlib import Path

CORNERS = Path("../out/notebooks/coverage_record/corners.csv")  # your own corners, or the folder of a run with marks
VEHICLE = Path("../onboard/made_up_flail.vehicle.toml")  # your own vehicle file
RUN = Path("../out/notebooks/coverage_record/run")  # your own recorded run
OUTPUT = Path("../out/notebooks/coverage_record")

# %% [markdown]
# If you have no corners, this cell uses three corners of a field of 12 by 9 m. The plan connects the first swath to the middle one by wide turns to one side (Zamboni). `lgprjax cover plan` does the same.

# %%
import lgprjax as lx

OUTPUT.mkdir(parents=True, exist_ok=True)
if not CORNERS.exists():
    CORNERS.write_text(
        "latitude_deg,longitude_deg\n"
        "40.7625000000,-113.8956000000\n40.7625369587,-113.8954664520\n40.7626131161,-113.8955029075\n"
    )
plan = lx.plan_coverage(CORNERS, VEHICLE, overlap=0.25).save(OUTPUT / "field.cover.geojson", force=True)
pattern = plan.plan.pattern
print(f"{len(pattern.lines)} lines {pattern.spacing_m:.2f} m apart, {pattern.length_m:.0f} m in all")
room_m = pattern.settings.turning_room_m
print(f"tightest turn {pattern.tightest_radius_m:.2f} m, up to {room_m:g} m beyond the perimeter")
axes = plan.plot()

# %% [markdown]
# If you have no run, this cell simulates a drive along the plan at 0.35 m/s, with GNSS for 60 s of every 90 s. Without GNSS, the position sigma grows from 1.2 to 13 cm. The tool stops for five seconds during the run.

# %%
import numpy as np

from lgprjax.coverage import lay_pattern
from lgprjax.run_records import COVER, Record, RecordKind, Source, pack

if not RUN.exists():
    route = lay_pattern(pattern)
    way = np.asarray(route.rows[: int(route.count)], float)
    time_s = np.arange(0.0, float(route.length_m) / 0.35, 0.1)
    at = np.minimum((0.35 * time_s / float(route.spacing_m)).astype(int), len(way) - 1)
    rows = np.zeros(len(time_s), COVER)
    rows["x_m"], rows["y_m"], rows["yaw_rad"] = way[at, :3].T
    off_s = np.maximum(time_s % 90.0 - 60.0, 0.0)
    rows["covariance"] = np.diag([1.0, 1.0, 0.0])[None] * ((0.012 + 0.004 * off_s) ** 2)[:, None, None]
    rows["covariance"][:, 2, 2] = 0.006**2
    rows["line"], rows["speed_mps"], rows["depth_m"] = np.asarray(route.line)[at], 0.35, 0.15
    rows["tool"], rows["gnss_quality"] = np.where(rows["line"] >= 0, 15, 0), np.where(off_s > 0.0, 0, 3)
    stopped = (time_s > 200.0) & (time_s < 205.0)
    rows["tool"][stopped], rows["stop"][stopped] = 1, 4

# %% [markdown]
# Write the drive in the format of an onboard recording.

# %%
import json
import uuid

from lgprjax.files import file_hash
from lgprjax.run_segment import SegmentHead, pack_head, pack_record

if not RUN.exists():
    run, begin_ns = uuid.UUID(int=1).bytes, 10**12
    parts = [pack_head(SegmentHead(run, 0, 1_800_000_000 * 10**9, begin_ns, 0))]
    header = json.dumps({"plan_sha256": file_hash(plan.path)}).encode()
    records = [Record(RecordKind.HEADER, Source.CONTROL, 0, begin_ns, header)]
    records += [
        Record(RecordKind.COVER, Source.CONTROL, 0, begin_ns + int(1e9 * time_s[row]), rows[row].tobytes())
        for row in range(len(rows))
    ]
    parts += [pack_record(run, number, 1, 0, pack(each)) for number, each in enumerate(records)]
    RUN.mkdir()
    (RUN / "0000.lgprun").write_bytes(b"".join(parts))
print("the run's segments:", *(path.name for path in sorted(RUN.glob("*.lgprun"))))

# %% [markdown]
# Each cell gets the probability of its best pass, from the pose, its covariance and the tool's rectangle. The second half of each sentence is Markov's bound, which holds for any correlation between the errors of neighbouring cells. `lgprjax cover record` does the same.

# %%
worked = lx.record_coverage(plan, RUN, OUTPUT / "field.worked.h5", cell_m=0.1, force=True)
for layer in worked.figures.layers:
    print(layer.sentence)
print("stops:", worked.figures.stops)
axes = worked.plot()

# %% [markdown]
# Files for handover: GeoPackage, GeoJSON, KML, turning points, and a report to sign, as written by `lgprjax cover export`.

# %%
files = worked.export(OUTPUT / "export", force=True)
print(*sorted(path.name for path in files), sep="\n")

# %% [markdown]
# Plan the remaining gaps (`lgprjax cover plan ... --gaps field.worked.h5`). In the combined record of both runs, each cell has the larger of its two probabilities.

# %%
rest = lx.plan_coverage(CORNERS, VEHICLE, overlap=0.25, gaps_of=worked, level=0.95)
print("left below 95 %:", rest)
