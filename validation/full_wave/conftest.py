"""gprMax as a fixture: found once, its files in a folder of the session that pytest throws away."""

import pytest

from validation.full_wave import fdtd as outside
from validation.full_wave.fdtd import Fdtd, Recording
from validation.full_wave.fdtd_model import CELL_M, HEIGHT_M, PLATE_M, Model, Plate


@pytest.fixture(scope="session")
def fdtd(tmp_path_factory: pytest.TempPathFactory) -> Fdtd:
    """Computes a model: name, model, places of the antenna along the track."""
    python = outside.find_gprmax()
    folder = tmp_path_factory.mktemp("gprmax")
    return lambda name, model, antenna_m: outside.record(python, folder, name, model, antenna_m)


@pytest.fixture(scope="session")
def plate(fdtd: Fdtd) -> Recording:
    """Echo of a metal plate in air at PLATE_M below the antenna, two dimensions."""
    air = Model(along_m=(-0.8, 0.8), below_m=0.4, above_m=0.5, cell_m=CELL_M, window_ns=24.0)
    metal = air.with_parts(Plate(PLATE_M - HEIGHT_M))
    background = fdtd("air", air, [0.0])
    return background._replace(field=fdtd("plate", metal, [0.0]).field - background.field)
