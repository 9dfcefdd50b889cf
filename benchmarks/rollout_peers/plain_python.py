"""A tracker as it is copied from teaching code: one vehicle, lists, a search of the whole path in every step.

Its law is the exact one, by Newton's method with ``math.tan``, and its motion an exact arc, so that it ends where the
others do; only the way of getting there is the usual one.
"""

import math
import time

import numpy as np

from benchmarks.rollout_peers.work import arguments, finish
from benchmarks.rollout_problem import COLUMNS, STEP_S, RolloutProblem, load_problem

LANES = 4


def track(problem: RolloutProblem, lane: int, steps: int) -> tuple[float, float, float, float]:
    """Final x, y, yaw and the RMS error of one lane."""
    rows = problem.rows.astype(float)
    path_x, path_y, bend = rows[1:, 0].tolist(), rows[1:, 1].tolist(), rows[1:, 4].tolist()
    heading = [math.atan2(sin, cos) for cos, sin in zip(rows[1:, 2].tolist(), rows[1:, 3].tolist(), strict=True)]
    vehicle = dict(zip(COLUMNS, problem.lanes[:, lane].astype(float).tolist(), strict=True))
    base, lead, ratio = vehicle["wheelbase_m"], vehicle["anchor_m"], vehicle["ratio"]
    way = vehicle["speed_mps"] * STEP_S
    gain = 1.0 / (1.0 + (vehicle["speed_mps"] / vehicle["v_char_mps"]) ** 2)
    yaw = heading[0]
    x = path_x[0] - vehicle["offset_m"] * math.sin(yaw) - lead * math.cos(yaw)
    y = path_y[0] + vehicle["offset_m"] * math.cos(yaw) - lead * math.sin(yaw)
    motor = wheel = total = 0.0
    for _ in range(steps):
        anchor_x, anchor_y = x + lead * math.cos(yaw), y + lead * math.sin(yaw)
        distances = [math.hypot(px - anchor_x, py - anchor_y) for px, py in zip(path_x, path_y, strict=True)]
        near = distances.index(min(distances))
        east, north = anchor_x - path_x[near], anchor_y - path_y[near]
        if near and east * math.cos(heading[near]) + north * math.sin(heading[near]) < 0.0:
            near -= 1
            east, north = anchor_x - path_x[near], anchor_y - path_y[near]
        along = east * math.cos(heading[near]) + north * math.sin(heading[near])
        aside = north * math.cos(heading[near]) - east * math.sin(heading[near])
        if abs(bend[near]) > 1e-9:
            passed = math.atan2(bend[near] * along, 1.0 - bend[near] * aside) / bend[near]
            error = (1.0 - math.hypot(bend[near] * along, 1.0 - bend[near] * aside)) / bend[near]
        else:
            passed, error = along, aside
        total += error * error
        goal_x, goal_y = _goal(problem, near, passed + vehicle["look_ahead_m"], path_x, path_y, heading, bend)
        distance = math.hypot(goal_x - anchor_x, goal_y - anchor_y)
        bearing = math.atan2(goal_y - anchor_y, goal_x - anchor_x) - yaw
        command = _law(distance, bearing, base, lead, ratio, gain, vehicle["largest_rad"])
        wrong = command - motor
        wrong = math.copysign(max(abs(wrong) - vehicle["dead_band_rad"], 0.0), wrong)
        moved = wrong * (1.0 - math.exp(-STEP_S / vehicle["lag_s"]))
        most = vehicle["rate_radps"] * STEP_S
        motor += min(max(moved, -most), most)
        play = 0.5 * vehicle["backlash_rad"]
        wheel = min(max(wheel, motor - play), motor + play)
        behind = math.tan(ratio * wheel)
        turn = gain * way * (math.tan(wheel) + behind) / base
        size = math.sin(turn) / turn if abs(turn) > 1e-9 else 1.0
        bow = (1.0 - math.cos(turn)) / turn if abs(turn) > 1e-9 else 0.5 * turn
        forward, left = way * (size + bow * gain * behind), way * (bow - size * gain * behind)
        x += math.cos(yaw) * forward - math.sin(yaw) * left
        y += math.sin(yaw) * forward + math.cos(yaw) * left
        yaw += turn
    return x, y, yaw, math.sqrt(total / steps)


def _goal(
    problem: RolloutProblem,
    near: int,
    way_m: float,
    path_x: list[float],
    path_y: list[float],
    heading: list[float],
    bend: list[float],
) -> tuple[float, float]:
    at = near
    while way_m > problem.spacing_m and at < len(path_x) - 1:
        way_m -= problem.spacing_m
        at += 1
    middle = heading[at] + 0.5 * bend[at] * way_m
    chord = way_m * (1.0 - (bend[at] * way_m) ** 2 / 24.0)
    return path_x[at] + chord * math.cos(middle), path_y[at] + chord * math.sin(middle)


def _law(distance: float, bearing: float, base: float, lead: float, ratio: float, gain: float, largest: float) -> float:
    front = 0.5 * distance + lead * math.cos(bearing)
    rear = 0.5 * distance + (lead - base) * math.cos(bearing)
    wanted = base * math.sin(bearing) / gain
    angle = math.atan2(wanted, front + ratio * rear)
    for _ in range(4):
        angle = min(max(angle, -largest), largest)
        value = front * math.tan(angle) + rear * math.tan(ratio * angle) - wanted
        rise = front * (1.0 + math.tan(angle) ** 2) + ratio * rear * (1.0 + math.tan(ratio * angle) ** 2)
        angle -= value / rise
    return min(max(angle, -largest), largest)


def main() -> None:
    """The program: a few lanes one after another; more would only take longer."""
    chosen = arguments("plain_python")
    problem = load_problem(chosen.problem)
    lanes = min(LANES, problem.lanes.shape[1])
    begin = time.perf_counter()
    found = np.array([track(problem, lane, chosen.steps) for lane in range(lanes)])
    taken_s = [time.perf_counter() - begin]
    pose = np.stack([found[:, 0], found[:, 1], np.cos(found[:, 2]), np.sin(found[:, 2])])
    finish(chosen, taken_s, lanes, pose, found[:, 3])


if __name__ == "__main__":
    main()
