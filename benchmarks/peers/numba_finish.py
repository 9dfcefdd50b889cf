"""Gauss-Newton on along, cross, height, heading and roll in Numba: bilinear map, phase ramps, scale projected out.

The model of a trace is s R(delay) g(place). All products are taken in the map's frame of delay: only the scan is
turned, and with mx, my the map's slopes and mt = -iω g its change with delay, thirteen sums a channel give the normal
equations of all five dimensions by the chain rule.
"""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

from math import factorial

import numpy as np
from numba import njit

from benchmarks.registration import CHANNEL_LEFT_M, CHANNELS, HEIGHT_REFERENCE_M, LIGHT_SPEED_M_PER_NS

HALF_ROW = 24
_PER_M = 2.0 / LIGHT_SPEED_M_PER_NS
_LEFT = CHANNEL_LEFT_M.astype(np.float64)
_CAPS = np.array([0.08, 0.08, 0.03, np.deg2rad(2.0), np.deg2rad(1.0)])
_C = tuple(np.float32((-1) ** n / factorial(2 * n)) for n in range(1, 7))
_S = tuple(np.float32((-1) ** n / factorial(2 * n + 1)) for n in range(1, 7))
_NUMBERS = 484.0
"""Independent numbers of a scan: what the residual's variance is made from."""


@njit(fastmath=True)
def _channel_sums(g00, g01, g10, g11, a, b, omega, heard, delay, sums):
    """gg, g·mx, g·my, mx·mx, mx·my, my·my, mx·mt, my·mt, mt·mt, then heard·(g, mx, my, mt); slopes a cell.

    The trace is turned ``delay`` earlier by Taylor series of cosine and sine, good to 1e-6 below 2 rad, since calls
    of the library would keep the loop from running in vectors.
    """
    zero, one = np.float32(0.0), np.float32(1.0)
    gg, gx, gy, xx, xy, yy, xt, yt, tt = zero, zero, zero, zero, zero, zero, zero, zero, zero
    hg, hx, hy, ht = zero, zero, zero, zero
    for k in range(HALF_ROW):
        q = HALF_ROW + k
        low, high = g00[k] + b * (g01[k] - g00[k]), g10[k] + b * (g11[k] - g10[k])
        low_i, high_i = g00[q] + b * (g01[q] - g00[q]), g10[q] + b * (g11[q] - g10[q])
        mx, mx_i = high - low, high_i - low_i
        g, g_i = low + a * mx, low_i + a * mx_i
        my = (one - a) * (g01[k] - g00[k]) + a * (g11[k] - g10[k])
        my_i = (one - a) * (g01[q] - g00[q]) + a * (g11[q] - g10[q])
        mt, mt_i = omega[k] * g_i, -omega[k] * g
        gg += g * g + g_i * g_i
        gx += g * mx + g_i * mx_i
        gy += g * my + g_i * my_i
        xx += mx * mx + mx_i * mx_i
        xy += mx * my + mx_i * my_i
        yy += my * my + my_i * my_i
        xt += mx * mt + mx_i * mt_i
        yt += my * mt + my_i * mt_i
        tt += mt * mt + mt_i * mt_i
        angle = omega[k] * delay
        v = angle * angle
        cos = one + v * (_C[0] + v * (_C[1] + v * (_C[2] + v * (_C[3] + v * (_C[4] + v * _C[5])))))
        sin = angle * (one + v * (_S[0] + v * (_S[1] + v * (_S[2] + v * (_S[3] + v * (_S[4] + v * _S[5]))))))
        h, h_i = heard[k] * cos - heard[q] * sin, heard[q] * cos + heard[k] * sin
        hg += h * g + h_i * g_i
        hx += h * mx + h_i * mx_i
        hy += h * my + h_i * my_i
        ht += h * mt + h_i * mt_i
    sums[0], sums[1], sums[2], sums[3], sums[4], sums[5], sums[6] = gg, gx, gy, xx, xy, yy, xt
    sums[7], sums[8], sums[9], sums[10], sums[11], sums[12] = yt, tt, hg, hx, hy, ht


@njit(fastmath=True)
def _normal_equations(rows, cross, frame, omega, heard, pose, sums, gram, slope, pull):
    """Fills JᵀJ, Jᵀm, Jᵀh over all channels; returns m·h and m·m."""
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    lift, lift_slope = np.sin(pose[4]), np.cos(pose[4])
    gram[:], slope[:], pull[:] = 0.0, 0.0, 0.0
    product, power = 0.0, 0.0
    for channel in range(CHANNELS):
        left = _LEFT[channel]
        x = (pose[0] - sin * left - frame[0]) / frame[2]
        y = (pose[1] + cos * left - frame[1]) / frame[3]
        i, j = int(x), int(y)
        node = i * cross + j
        delay = np.float32(_PER_M * (pose[2] + left * lift - HEIGHT_REFERENCE_M))
        four = rows[node], rows[node + 1], rows[node + cross], rows[node + cross + 1]
        _channel_sums(*four, np.float32(x - i), np.float32(y - j), omega, heard[channel], delay, sums)
        p, q = 1.0 / frame[2], 1.0 / frame[3]
        xx, xy, yy, xt, yt = sums[3] * p * p, sums[4] * p * q, sums[5] * q * q, sums[6] * p, sums[7] * q
        power += sums[0]
        product += sums[9]
        e, n, t = -cos * left, -sin * left, _PER_M
        r = t * left * lift_slope
        gram[0, 0] += xx
        gram[1, 0] += xy
        gram[1, 1] += yy
        gram[2, 0] += xt * t
        gram[2, 1] += yt * t
        gram[2, 2] += sums[8] * t * t
        gram[3, 0] += xx * e + xy * n
        gram[3, 1] += xy * e + yy * n
        gram[3, 2] += (xt * e + yt * n) * t
        gram[3, 3] += xx * e * e + 2.0 * xy * e * n + yy * n * n
        gram[4, 0] += xt * r
        gram[4, 1] += yt * r
        gram[4, 2] += sums[8] * t * r
        gram[4, 3] += (xt * e + yt * n) * r
        gram[4, 4] += sums[8] * r * r
        for into, mx, my, mt in ((slope, sums[1], sums[2], 0.0), (pull, sums[10], sums[11], sums[12])):
            into[0] += mx * p
            into[1] += my * q
            into[2] += mt * t
            into[3] += mx * p * e + my * q * n
            into[4] += mt * r
    return product, power


@njit(fastmath=True)
def _solve(matrix, right):
    """Cholesky in place of a 5 × 5 matrix given by its lower half; ``right`` becomes the solution."""
    for i in range(5):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(max(total, 1e-12)) if i == j else total / matrix[j, j]
    for i in range(5):
        for k in range(i):
            right[i] -= matrix[i, k] * right[k]
        right[i] /= matrix[i, i]
    for i in range(4, -1, -1):
        for k in range(i + 1, 5):
            right[i] -= matrix[k, i] * right[k]
        right[i] /= matrix[i, i]


@njit(fastmath=True)
def finish(rows, cross, frame, omega, heard, pose, steps):
    """Refine ``pose`` in place; returns r there. Height, heading and roll know the box as a prior, three sigma wide.

    ``frame`` holds origin (2), cell (2), prior (5), half width (5).
    """
    sums, gram, slope, pull = np.empty(13), np.empty((5, 5)), np.empty(5), np.empty(5)
    strength = 0.0
    for channel in range(CHANNELS):
        for k in range(2 * HALF_ROW):
            strength += heard[channel, k] * heard[channel, k]
    for _ in range(steps):
        product, power = _normal_equations(rows, cross, frame, omega, heard, pose, sums, gram, slope, pull)
        if product <= 0.0:
            return -1.0
        scale = product / power
        level = _NUMBERS / (strength - scale * product)
        for i in range(5):
            pull[i] = scale * (pull[i] - slope[i] * scale) * level
            for j in range(i + 1):
                gram[i, j] = scale * scale * (gram[i, j] - slope[i] * slope[j] / power) * level
        for d in range(2, 5):
            known = 9.0 / (frame[9 + d] * frame[9 + d])
            gram[d, d] += known
            pull[d] += known * (frame[4 + d] - pose[d])
        _solve(gram, pull)
        for d in range(5):
            moved = pose[d] + min(_CAPS[d], max(-_CAPS[d], pull[d]))
            pose[d] = min(frame[4 + d] + frame[9 + d], max(frame[4 + d] - frame[9 + d], moved))
    product, power = _normal_equations(rows, cross, frame, omega, heard, pose, sums, gram, slope, pull)
    return product / np.sqrt(power * strength)
