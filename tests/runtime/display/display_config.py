"""Configurations of a run whose display is what matters."""

from pathlib import Path
from typing import Any

from lgprjax.runtime.config import DisplayTable, PortsTable, PortTable, RuntimeConfig

TOKEN = "correct horse battery staple"


def config_with(**display: Any) -> RuntimeConfig:
    """A configuration with these values of ``[display]``."""
    line = PortTable(url="/dev/null")
    ports = PortsTable(drive_by_wire=line, controller=line, gnss=line, radar=line)
    return RuntimeConfig(
        file=Path("CONFIG.toml"),
        name="testing",
        vehicle="x.vehicle.toml",
        map="x.map.h5",
        routes=["x.map.h5"],
        ports=ports,
        display=DisplayTable(**display),
    )
