"""Direct waves and neighbouring lines that were made here, so that what is to be found is known beforehand."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from lgprjax.radar.survey_lines import compare_neighbours, echo_image, pick_direct_wave

_INTERVAL_NS, _FREQUENCY_HZ, _STEP_M = 0.8, 100e6, 0.25
_PERIOD = 1e9 / (_FREQUENCY_HZ * _INTERVAL_NS)
"""12.5 samples."""


def _ricker(samples: int, middle: float) -> np.ndarray:
    """Of the centre frequency, 1 at its middle; its side lobes are the other way."""
    phase = (np.pi * (np.arange(samples) - middle) / _PERIOD) ** 2
    return np.asarray((1.0 - 2.0 * phase) * np.exp(-phase))


def _tapered(samples: int, begin: float) -> np.ndarray:
    """Two periods of a sine that swells from nothing and dies away; its first lobe is positive."""
    at = (np.arange(samples) - begin) / (2.0 * _PERIOD)
    inside = (at > 0.0) & (at < 1.0)
    return np.where(inside, np.sin(np.pi * at) ** 2 * np.sin(4.0 * np.pi * at), 0.0)


def _line(wave: np.ndarray, *, noise: float = 0.0, seed: int = 0, traces: int = 40) -> np.ndarray:
    """Traces of the wave, strength 20000, with noise in counts."""
    rng = np.random.default_rng(seed)
    counts = 20000.0 * wave + noise * rng.normal(size=(traces, len(wave)))
    return np.rint(counts).astype(np.int16)


@pytest.mark.parametrize(("sign", "middle"), [(1, 40), (-1, 57)])
def test_ricker_wave(sign: int, middle: int) -> None:
    wave = pick_direct_wave(_line(sign * _ricker(200, middle), noise=200.0), _INTERVAL_NS, _FREQUENCY_HZ)
    assert wave.strongest == middle
    # Its first lobe lies before the middle one, and is the other way.
    assert wave.sign == -sign
    # It rises through a twentieth of the peak where the formula does, before its side lobe.
    fine = np.linspace(0, middle, 100_000)
    phase = (np.pi * (fine - middle) / _PERIOD) ** 2
    expected = fine[np.argmax(np.abs((1 - 2 * phase) * np.exp(-phase)) > 0.05)]
    assert wave.first_break == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize(("sign", "begin"), [(1, 20), (-1, 71.7)])
def test_swelling_wave(sign: int, begin: float) -> None:
    wave = pick_direct_wave(_line(sign * _tapered(160, begin), noise=100.0), _INTERVAL_NS, _FREQUENCY_HZ)
    assert wave.sign == sign
    assert begin < wave.first_break < begin + 0.5 * _PERIOD
    assert begin + 0.5 * _PERIOD < wave.strongest < begin + 1.5 * _PERIOD


def test_first_break_moves_by_parts_of_a_sample() -> None:
    picked = [
        pick_direct_wave(_line(_tapered(160, 50.0 + part)), _INTERVAL_NS, _FREQUENCY_HZ).first_break
        for part in (0.0, 0.25, 0.5, 0.75, 1.0)
    ]
    np.testing.assert_allclose(np.array(picked) - picked[0], [0.0, 0.25, 0.5, 0.75, 1.0], atol=0.08)


@pytest.mark.parametrize("limit", [0.5, 0.3])
def test_clipped_wave_keeps_its_place(limit: float) -> None:
    # The side lobes of a Ricker wave have 0.446 of its peak: with 0.3 they are clipped too.
    wave = np.clip(_ricker(200, 90), -limit, limit)
    picked = pick_direct_wave(_line(wave), _INTERVAL_NS, _FREQUENCY_HZ)
    if limit > 0.446:
        assert picked.strongest == pytest.approx(90, abs=0.5)
    else:
        # The first of the clipped lobes then: the Ricker's side lobe, sqrt(1.5) / pi of a period before the middle.
        assert picked.strongest == pytest.approx(90 - np.sqrt(1.5) / np.pi * _PERIOD, abs=1.5)
    assert picked.sign == -1


def test_a_receiver_off_zero_and_echoes_of_single_traces_do_not_count() -> None:
    line = _line(_ricker(200, 60))
    plain = pick_direct_wave(line, _INTERVAL_NS, _FREQUENCY_HZ)
    off = pick_direct_wave(line + np.int16(3000), _INTERVAL_NS, _FREQUENCY_HZ)
    np.testing.assert_allclose(off, plain, atol=0.05)
    line[:5, 10:20] = 30000
    assert pick_direct_wave(line, _INTERVAL_NS, _FREQUENCY_HZ).strongest == 60


@pytest.mark.parametrize("middle", [-2, 4])
def test_record_that_begins_later_shows_no_first_break(middle: int) -> None:
    picked = pick_direct_wave(_line(_ricker(120, middle), noise=50.0), _INTERVAL_NS, _FREQUENCY_HZ)
    assert np.isnan(picked.first_break)
    assert picked.sign == 0
    silent = pick_direct_wave(np.full((20, 60), 17, np.int16), _INTERVAL_NS, _FREQUENCY_HZ)
    assert np.isnan([silent.first_break, silent.strongest]).all()
    assert silent.sign == 0


def _ground(seed: int, traces: int = 200, rows: int = 60) -> np.ndarray:
    """Scatterers at random places, as wide as echoes are along a line."""
    return np.asarray(gaussian_filter(np.random.default_rng(seed).normal(size=(traces, rows)), (1.5, 1.0)))


def _noisy(image: np.ndarray, seed: int, share: float) -> np.ndarray:
    """With other ground of a share of its strength on top."""
    other = _ground(10_000 + seed)
    return np.asarray(image + share * image.std() * other[: len(image)] / other.std())


@pytest.mark.parametrize(
    ("seed", "backwards", "sign", "lag"), [(0, False, 1, -12), (1, True, 1, -1), (2, False, -1, 0), (3, True, -1, 16)]
)
def test_shifted_neighbour(seed: int, backwards: bool, sign: int, lag: int) -> None:
    ground = _ground(seed)
    neighbour = _noisy(ground[20:170], seed, 0.7)
    # Its first trace lies beside trace `lag` of its neighbour.
    line = sign * _noisy(ground[20 + lag : 160 + lag], seed + 500, 0.7)
    found = compare_neighbours(line[::-1] if backwards else line, neighbour, _STEP_M)
    assert found.reversed is backwards
    assert found.lag_m == pytest.approx(lag * _STEP_M)
    assert np.sign(found.correlation) == sign
    # Two pictures with noise of 0.7 of the ground's strength each share 1 / 1.49 of their energy.
    assert abs(found.correlation) == pytest.approx(1.0 / 1.49, abs=0.12)
    assert found.certainty > 2.5
    assert found.sign_certainty > 2.5


@pytest.mark.parametrize("length", [60, 199])
def test_lines_of_unlike_length(length: int) -> None:
    ground = _ground(3, traces=240)
    line, neighbour = ground[30 : 30 + length], ground[24:180]
    found = compare_neighbours(line, neighbour, _STEP_M)
    assert (found.lag_m, found.reversed) == (6 * _STEP_M, False)
    assert found.correlation == pytest.approx(1.0, abs=1e-6)
    # The other way about: the neighbour lies six traces before it.
    back = compare_neighbours(neighbour, line, _STEP_M)
    assert (back.lag_m, back.reversed) == (-6 * _STEP_M, False)


def test_a_direction_that_is_not_tried_is_not_found() -> None:
    ground = _ground(5)
    found = compare_neighbours(ground[::-1], ground, _STEP_M, directions=(False,))
    assert found.reversed is False
    assert found.correlation < 0.3


def test_unrelated_lines_are_not_certain() -> None:
    """Bounds of 2.5 (direction, start) and 2.0 (sign) are what import believes; chance must not reach them."""
    certain = {"direction": 0, "sign": 0, "start": 0}
    seeds = 60
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        images = [
            echo_image(
                gaussian_filter(rng.normal(size=(120, 200)), (1.5, 1.0)), 30.0, _INTERVAL_NS, _FREQUENCY_HZ, _STEP_M
            )
            for _ in range(2)
        ]
        both = compare_neighbours(images[0], images[1], _STEP_M)
        one = compare_neighbours(images[0], images[1], _STEP_M, directions=(False,))
        certain["direction"] += both.certainty >= 2.5
        certain["sign"] += one.sign_certainty >= 2.0
        certain["start"] += one.sign_certainty >= 2.5
    # Measured over 3000 pairs of six shapes: none, 0.03 % and none.
    assert certain["direction"] <= 0.01 * seeds
    assert certain["sign"] <= 0.02 * seeds
    assert certain["start"] <= 0.01 * seeds


def test_echo_image_forgets_what_stays_along_the_line_and_levels_depths() -> None:
    rng = np.random.default_rng(9)
    depth = np.exp(-np.arange(300) / 40.0)
    ground = gaussian_filter(rng.normal(size=(200, 300)), (1.5, 2.0)) * depth * 1000.0
    steady = 30000.0 * _ricker(300, 45) + 5000.0 * np.sin(np.arange(300) / 3.0)
    bare = echo_image(ground, 40.0, _INTERVAL_NS, _FREQUENCY_HZ, _STEP_M)
    with_steady = echo_image(ground + steady, 40.0, _INTERVAL_NS, _FREQUENCY_HZ, _STEP_M)
    np.testing.assert_allclose(with_steady, bare, atol=1e-6)
    np.testing.assert_allclose(np.sqrt(np.mean(bare**2, axis=0)), 1.0)
    # What comes up to one and a half periods after the break is left out.
    assert bare.shape[1] < 300 - 40


@pytest.mark.parametrize(("traces", "samples"), [(3, 200), (200, 12)])
def test_lines_that_are_too_small_are_like_nothing(traces: int, samples: int) -> None:
    image = echo_image(np.ones((traces, samples)), 2.0, _INTERVAL_NS, _FREQUENCY_HZ, _STEP_M)
    found = compare_neighbours(image, image, _STEP_M)
    assert found.correlation == found.certainty == found.sign_certainty == 0.0
