"""A writer of a map killed at random moments: the map is whole, the old or the new one, and the next writer works."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from canon.map import write_made_map
from lgprjax.formats import MAP_PRECISIONS, MapFile, check_file, locked_map

KILLS = 6

# Writes the map anew again and again, as an update does: a scratch map, then the map itself. Forks, because to start
# Python for each of the kills takes longer than all the writing.
_WRITER = """
import os, sys
from pathlib import Path
from lgprjax.formats import MapFile, MapWriter, copy_stations, locked_map, scratch_folder

def write(target):
    while True:
        with locked_map(target), MapFile.open(target) as source:
            rounds = 1 + int(source.provenance.get("rounds", 0))
            scratch_folder(target).mkdir(exist_ok=True)
            for output in (scratch_folder(target) / "whole.map.h5", target):
                with MapWriter.create(output, force=True) as writer:
                    copy_stations(source, writer)
                    provenance = {**source.provenance, "rounds": rounds}
                    tiles = (source.tile_frame, source.height_reference_m)
                    writer.finish(source.description, *tiles, provenance, source.retired.astype(int))

target = Path(sys.argv[1])
print("ready", flush=True)
for _ in sys.stdin:
    child = os.fork()
    if not child:
        write(target)
    print(child, flush=True)
    os.waitpid(child, 0)
    print("gone", flush=True)
"""


def rounds_of(target: Path) -> int:
    """How often the map has been written."""
    with MapFile.open(target) as source:
        return int(str(source.provenance.get("rounds", 0)))


def test_killed_at_random_moments(tmp_path: Path) -> None:
    target = tmp_path / "road.map.h5"
    write_made_map(target, MAP_PRECISIONS["standard"], 300)
    every = np.arange(0, 600, 50)
    with MapFile.open(target) as source:
        pose, traces = source.pose, source.read_stations(every).profile
    rng = random.Random(5)
    root = Path(__file__).parents[2]
    process = subprocess.Popen(
        [sys.executable, "-W", "ignore", "-c", _WRITER, str(target)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=root,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    rounds, with_remains, round_s = 0, 0, 0.0
    try:
        assert process.stdout.readline() == "ready\n"
        for number in range(KILLS):
            process.stdin.write("\n")
            process.stdin.flush()
            child, began = int(process.stdout.readline()), time.monotonic()
            if number == 0:  # as long as this machine takes
                while rounds_of(target) < 3:
                    assert time.monotonic() - began < 100.0
                    time.sleep(0.01)
                round_s = (time.monotonic() - began) / 3.0
            time.sleep(rng.uniform(0.0, 1.5 * round_s))
            os.kill(child, signal.SIGKILL)
            assert process.stdout.readline() == "gone\n"
            assert check_file(target) == []
            assert rounds_of(target) >= rounds  # what was written stays written
            rounds = rounds_of(target)
            with MapFile.open(target) as source:
                np.testing.assert_array_equal(source.pose, pose)
                np.testing.assert_array_equal(source.read_stations(every).profile, traces)
            with_remains += len(list(tmp_path.iterdir())) > 1
            if rng.random() < 0.5:
                with locked_map(target):
                    assert sorted(path.name for path in tmp_path.iterdir()) == [".road.map.h5.lock", "road.map.h5"]
                assert list(tmp_path.iterdir()) == [target]
    finally:
        process.stdin.close()
        process.wait(timeout=20)
        process.stdout.close()
    assert rounds > 3
    assert with_remains > 1
