"""Pieces of a map at other places of it: their own place must not be in the region that they are searched in."""

import numpy as np
import pytest

from lgprjax.batch import chance
from lgprjax.formats import MapFile
from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings
from lgprjax.subsurface import MapDescription

STEP_M, PITCH_M, CHANNELS = 0.1, 0.25, 12


class StraightRoad(MapFile):
    """Two baselines side by side, without traces."""

    def __init__(self, heading_deg: float, wavelength_m: float) -> None:
        yaw, count = np.radians(heading_deg), 500
        along = STEP_M * np.arange(count)
        self._pose, self._drive = np.zeros((2 * count, 5)), np.repeat([0, 1], count)
        for drive, left_m in enumerate((0.0, 2.6)):
            own = self._drive == drive
            self._pose[own, 0] = along * np.cos(yaw) - left_m * np.sin(yaw)
            self._pose[own, 1] = along * np.sin(yaw) + left_m * np.cos(yaw)
            self._pose[own, 3] = yaw
        settings = ChainSettings(30e6, 200e6, 15.0, 4.0, STEP_M, wavelength_m)
        self.description = MapDescription(
            "road", LocalFrame(46.0, 8.0, 0.0), settings, PITCH_M, CHANNELS, 2.0, np.ones(8)
        )

    @property
    def pose(self) -> np.ndarray:
        """Of the stations."""
        return self._pose

    @property
    def drive(self) -> np.ndarray:
        """Of the stations."""
        return self._drive


@pytest.mark.parametrize(("heading_deg", "wavelength_m"), [(45.0, 0.3), (110.0, 1.0)])
def test_the_true_place_of_a_false_piece_is_outside_its_region(heading_deg: float, wavelength_m: float) -> None:
    """The region is a square about the vehicle that turns with its heading; ground near it resembles it."""
    source, channels, half_m = StraightRoad(heading_deg, wavelength_m), 6, 2.5
    yaw, count = np.radians(heading_deg), 0
    for piece in chance._swapped(source, channels, half_m):
        places = []
        for stations, first in ((piece.poses, piece.under), (piece.traces, piece.channel)):
            # Channel 0 is leftmost.
            left_m = PITCH_M * (0.5 * (CHANNELS - 1) - (first + 0.5 * (channels - 1)))
            places.append(source.pose[stations, :2] + left_m * np.array([-np.sin(yaw), np.cos(yaw)]))
        east, north = (places[0] - places[1]).T
        forward, left = np.cos(yaw) * east + np.sin(yaw) * north, np.cos(yaw) * north - np.sin(yaw) * east
        # Nor is ground in it that lies within two wavelengths of there.
        assert np.min(np.hypot(np.abs(forward), np.abs(left))) > half_m
        beyond = np.hypot(np.maximum(np.abs(forward) - half_m, 0.0), np.maximum(np.abs(left) - half_m, 0.0))
        assert beyond.min() > min(1.0, 2.0 * wavelength_m) - 1e-6
        count += 1
    assert count > 20
