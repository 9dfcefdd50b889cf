"""The live view, as a viewer of Foxglove's websocket receives it."""

import asyncio
import json
import logging
import os
import time
from pathlib import Path

import numpy as np
import pytest
import websockets

from lgprjax.frames import LocalFrame
from lgprjax.run_records import POSE, Record, RecordKind, Source, pack
from lgprjax.runtime.config import OutputTable, RuntimeConfig
from lgprjax.runtime.output.nmea import Given
from lgprjax.runtime.process import RINGS, Heartbeats, Started
from lgprjax.runtime.ring import Ring
from lgprjax.wire import Sender


def test_a_viewer_gets_scene_position_radargram_and_modes(
    config: RuntimeConfig, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    from lgprjax.runtime.output.live import LiveView

    caplog.set_level(logging.DEBUG)
    Heartbeats(tmp_path)
    rings = {name: Ring.create(tmp_path / name, RINGS[name]) for name in ("view_state", "view_scans")}
    port = 20000 + os.getpid() % 20000
    live = config.model_copy(update={"output": OutputTable(live_port=port)})
    view = LiveView(Started("output", live, tmp_path, tmp_path, False), LocalFrame(42.0, -71.0, 30.0))

    def feed() -> None:
        state = {"mode": "SPEED", "speed_mps": 2.0, "path": [[0.0, 0.0], [10.0, 1.0]], "warnings": []}
        rings["view_state"].put(
            pack(Record(RecordKind.STATE, Source.CONTROL, 1, time.monotonic_ns(), json.dumps(state).encode()))
        )
        sender, rng = Sender(5), np.random.default_rng(0)
        for number in range(30):
            fields = {"scan": number, "channels": 3, "samples": 40, "valid": 7}
            data = rng.integers(0, 256, 120, dtype=np.uint8).tobytes()
            frame = sender.frame("radar_scan", {**fields, "data": data}, mode=0, mono_ns=number)
            rings["view_scans"].put(pack(Record(RecordKind.PORT_IN, Source.RADAR, 0, 1, frame)))
        view.step()
        view.place(Given(1.8e9, 42.0, -71.0, 30.0, 90.0, 0.02, 0.02, 4), np.zeros((), POSE))

    async def watch() -> tuple[set[str], set[int]]:
        topics: dict[int, str] = {}
        heard: set[int] = set()
        url = f"ws://127.0.0.1:{port}"
        async with websockets.connect(url, subprotocols=[websockets.Subprotocol("foxglove.sdk.v1")]) as socket:
            end_s = time.monotonic() + 20.0
            while len(heard) < 5 and time.monotonic() < end_s:
                feed()
                try:
                    while True:
                        message = await asyncio.wait_for(socket.recv(), 0.2)
                        if isinstance(message, bytes):
                            heard.add(int.from_bytes(message[1:5], "little"))
                            continue
                        told = json.loads(message)
                        if told.get("op") == "advertise":
                            fresh = {int(each["id"]): each["topic"] for each in told["channels"]}
                            topics |= fresh
                            ask = [{"id": number, "channelId": number} for number in fresh]
                            await socket.send(json.dumps({"op": "subscribe", "subscriptions": ask}))
                except TimeoutError:
                    pass
        return set(topics.values()), heard

    try:
        topics, heard = asyncio.run(watch())
    finally:
        view.close()
    assert topics >= {"/modes", "/position", "/pose", "/radargram", "/scene"}
    assert len(heard) == 5
    # Its logging is what a connection and a message could wait for each other in.
    assert not [each for each in caplog.records if each.name.startswith("foxglove")]
