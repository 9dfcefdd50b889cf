"""The output process: gives the corrected position out, and serves the live view.

It only reads rings, so that clients, lines and viewers cannot delay the control loop.
"""

import signal
import time

import numpy as np

from lgprjax.formats import MapFile
from lgprjax.run_records import POSE, RecordKind, unpack
from lgprjax.runtime.output.nmea import NmeaOutlets, given_of, sentences
from lgprjax.runtime.process import ProcessStage, Started

ADDRESS_FILE = "nmea.address"
"""File in the folder of the rings with HOST:PORT of the sentences, for a port chosen by the system."""
_IDLE_S = 0.005
_OLD_NS = 1_000_000_000


class OutputProcess:
    """The process's state and its loop.

    Raises:
        InputError: the map cannot be read, an address cannot be listened at, or a package is missing.
    """

    def __init__(self, started: Started) -> None:
        table = started.config.output
        assert table is not None
        self._started, self._table = started, table
        with MapFile.open(started.config.path(started.config.map)) as source:
            self._frame = source.description.frame
        self._poses = started.ring("poses")
        self._outlets = NmeaOutlets(started.config, table)
        if self._outlets.address is not None:
            fresh = started.rings / f"{ADDRESS_FILE}.new"
            fresh.write_text("{}:{}".format(*self._outlets.address), encoding="ascii")
            fresh.rename(started.rings / ADDRESS_FILE)
        self._live = None
        if table.live_port is not None:
            from lgprjax.runtime.output.live import LiveView

            self._live = LiveView(started, self._frame)
        self._ended = False
        signal.signal(signal.SIGTERM, self._end)

    def run(self) -> None:
        """Until SIGTERM."""
        while not self._ended:
            self._started.beat(ProcessStage.READY)
            messages = self._poses.take()
            for message in messages:
                record = unpack(message)
                if record.kind is RecordKind.POSE:
                    self._give(np.frombuffer(record.payload, POSE)[0])
            if self._live is not None:
                self._live.step()
            if not messages:
                time.sleep(_IDLE_S)
        self._outlets.close()
        if self._live is not None:
            self._live.close()

    def _give(self, row: np.void) -> None:
        # What waited, as after a restart, is no present position.
        age_ns = time.monotonic_ns() - int(row["time_ns"])
        if age_ns > _OLD_NS:
            return
        given = given_of(row, self._frame, 1e-9 * (time.time_ns() - age_ns))
        self._outlets.send(sentences(given), time.monotonic())
        if self._live is not None:
            self._live.place(given, row)

    def _end(self, *_: object) -> None:
        self._ended = True


def run(started: Started) -> None:
    """The process."""
    OutputProcess(started).run()
