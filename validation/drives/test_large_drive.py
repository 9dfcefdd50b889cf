"""A drive of 10 GB is read, processed and registered in bounded memory."""

import json
import os
import resource
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from canon.site import Site
from lgprjax.formats import DriveLog, DriveWriter, NavigationTrack, OdometryTrack

GIGABYTES = float(os.environ.get("LGPRJAX_LARGE_GB", "10"))
LIMIT_BYTES = 2 * 1024**3


def write_large(source: Path, target: Path, gigabytes: float) -> int:
    """The live drive again and again as float32, first over the mapped road, then on and on beside it."""
    with DriveLog.open(source) as log:
        description = log.description
        traces, _ = log.read_traces(0, log.scans)
        stored = traces + np.float32(128)
        period_s = float(log.scan_time_s[-1]) + 1 / 126
        passes = int(np.ceil(gigabytes * 1e9 / stored.nbytes))
        navigation, odometry = description.navigation, description.odometry
        run_m = float(odometry.distance_m[-1])

        def again(values: np.ndarray, step: float) -> np.ndarray:
            return np.asarray((values[None] + step * np.arange(passes)[:, None]).reshape(-1))

        whole = navigation.time_s < period_s - 1e-9
        covered = odometry.time_s < period_s - 1e-9
        parts = {name: values[whole] for name, values in vars(navigation).items() if values is not None}
        # Nine passes in ten go on a kilometre away, where there is no map.
        away = np.where(np.arange(passes) % 10 == 0, 0.0, 0.01)
        track = {name: again(values, 0.0) for name, values in parts.items()}
        track["time_s"] = again(parts["time_s"], period_s)
        track["latitude_deg"] = track["latitude_deg"] + np.repeat(away, int(whole.sum()))
        large = replace(
            description,
            navigation=NavigationTrack(**track),
            odometry=OdometryTrack(
                again(odometry.time_s[covered], period_s), again(odometry.distance_m[covered], run_m)
            ),
            truth=None,
        )
        with DriveWriter.create(target, large, channels=log.channels, dtype=np.float32) as writer:
            for number in range(passes):
                writer.append(log.scan_time_s + number * period_s, stored)
        return passes * stored.nbytes


def test_ten_gigabytes_in_two(site: Site, tmp_path: Path) -> None:
    large = tmp_path / "large.drive.h5"
    size = write_large(site.logs["live"], large, GIGABYTES)
    assert size >= GIGABYTES * 1e9
    command = [sys.executable, "-c", "from lgprjax.cli import main; main()"]
    command += ["register", str(site.map), str(large), "-o", str(tmp_path / "out")]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    peak = 1024 * resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    (figures,) = json.loads((tmp_path / "out" / "summary.json").read_text())
    print(f"{size / 1e9:.1f} GB of traces, {figures['scans']} scans, peak {peak / 1e9:.2f} GB: {figures['counts']}")
    assert figures["counts"]["ok"] > 0.9 * figures["scans"] / 10
    assert peak < LIMIT_BYTES
