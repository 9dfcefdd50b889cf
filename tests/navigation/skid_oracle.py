"""The skid-steer filter once more: float64 NumPy, a cloned yaw for the INS, numerical derivatives, textbook updates."""

import numpy as np
from jaxtyping import Float

from lgprjax.navigation import SkidModel

X, Y, YAW, CLONE, SCALE, TURN, LEFT, RIGHT, AHEAD, DRIFT, SLOW_X, SLOW_Y = range(12)
State = Float[np.ndarray, "... 12"]
Numbers = dict[str, np.float64]


class Oracle:
    """Mean and covariance of x, y, yaw, the yaw when the INS last spoke, and the filter's other states."""

    def __init__(self, model: SkidModel, mean: State, covariance: Float[np.ndarray, "12 12"]) -> None:
        """From the filter's own states, whose fourth is the turn since then."""
        clone = np.eye(12)
        clone[CLONE, [YAW, CLONE]] = 1.0, -1.0
        self.m: Numbers = {name: np.float64(value) for name, value in model._asdict().items()}
        self.mean, self.covariance = clone @ mean, clone @ covariance @ clone.T
        self.rate_then = 0.0

    def rates(self, state: State, left: float, right: float) -> tuple[np.ndarray, np.ndarray]:
        """Speed and yaw rate by wheels as read."""
        ground_left = left * (1.0 + state[..., SCALE] + state[..., LEFT])
        ground_right = right * (1.0 + state[..., SCALE] + state[..., RIGHT])
        read = (right - left) / self.m["track_m"]
        share = read**2 / (read**2 + self.m["least_turn_radps"] ** 2)
        rate = (ground_right - ground_left) / self.m["track_m"] * (1.0 + share * state[..., TURN])
        return (ground_left + ground_right) / 2.0, rate

    def arc(self, state: State, travel: np.ndarray, turn: np.ndarray) -> State:
        """Along an arc on which the point ahead of the midpoint does not move aside."""
        after = state.copy()
        yaw, ahead = state[..., YAW], state[..., AHEAD]
        chord = travel * np.sinc(turn / (2.0 * np.pi))
        after[..., X] += ahead * (np.cos(yaw) - np.cos(yaw + turn)) + chord * np.cos(yaw + turn / 2.0)
        after[..., Y] += ahead * (np.sin(yaw) - np.sin(yaw + turn)) + chord * np.sin(yaw + turn / 2.0)
        after[..., YAW] += turn
        return after

    def predict(self, left: float, right: float, step_s: float) -> None:
        m = self.m

        def moved(state: State) -> State:
            speed, rate = self.rates(state, left, right)
            after = self.arc(state, speed * step_s, rate * step_s)
            after[..., LEFT] *= np.exp(-abs(left) * step_s / m["slip_m"])
            after[..., RIGHT] *= np.exp(-abs(right) * step_s / m["slip_m"])
            after[..., SLOW_X:] *= np.exp(-step_s / m["gnss_slow_s"])
            return after

        speed, rate = self.rates(self.mean, left, right)
        turns = [self.arc(self.mean, speed * step_s, rate * step_s + aside) for aside in (1e-5, -1e-5)]
        by_turn = (turns[0] - turns[1]) / 2e-5
        slopes = _slopes(moved, self.mean)
        self.mean = moved(self.mean)
        way, turned = (abs(left) + abs(right)) / 2.0 * step_s, abs(right - left) * step_s / m["track_m"]
        along, aside = np.zeros(12), np.zeros(12)
        along[:2] = np.cos(self.mean[YAW]), np.sin(self.mean[YAW])
        aside[:2] = -along[1], along[0]
        noise = (m["yaw_noise"] ** 2 * way + m["yaw_rest_noise"] ** 2 * step_s) * np.outer(by_turn, by_turn)
        noise += m["along_noise"] ** 2 * way * np.outer(along, along)
        noise += m["side_noise"] ** 2 * way * np.outer(aside, aside)
        walks = np.zeros(12)
        walks[SCALE], walks[TURN] = m["scale_walk"] ** 2 * way, m["turn_scale_walk"] ** 2 * turned
        for state, side in ((LEFT, left), (RIGHT, right)):
            walks[state] = m["slip_sigma"] ** 2 * (1.0 - np.exp(-2.0 * abs(side) * step_s / m["slip_m"]))
        walks[AHEAD], walks[DRIFT] = m["slip_ahead_walk_m"] ** 2 * turned, m["drift_walk"] ** 2 * step_s
        walks[SLOW_X:] = 1.0 - np.exp(-2.0 * step_s / m["gnss_slow_s"])
        self.covariance = slopes @ self.covariance @ slopes.T + noise + np.diag(walks)

    def hear_turn(self, turn: float, span_s: float, left: float, right: float) -> None:
        """A delta heading that ends with the tick and counts from the last one."""
        _, rate = self.rates(self.mean, left, right)
        row = np.zeros((1, 12))
        row[0, [YAW, CLONE, DRIFT]] = 1.0, -1.0, span_s
        noise = self.m["ins_noise"] ** 2 * span_s + (self.m["ins_clock_s"] * (rate - self.rate_then)) ** 2
        self.update(np.array([turn]) - row @ self.mean, row, np.array([[noise]]))

    def begin_turn(self, left: float, right: float) -> None:
        """The next delta heading counts from here."""
        clone = np.eye(12)
        clone[CLONE] = clone[YAW]
        self.mean, self.covariance = clone @ self.mean, clone @ self.covariance @ clone.T
        self.rate_then = float(self.rates(self.mean, left, right)[1])

    def hear_fix(
        self, place: np.ndarray, covariance: Float[np.ndarray, "2 2"], age_s: float, left: float, right: float
    ) -> None:
        m = self.m
        slow = np.sqrt(m["gnss_slow_share"] * np.diagonal(covariance))

        def seen(state: State) -> np.ndarray:
            speed, rate = self.rates(self.mean, left, right)
            # How far back the antenna was is taken from the estimate; the errors of that are smaller than a millimetre.
            fixed = state.copy()
            fixed[..., AHEAD] = self.mean[AHEAD]
            then = self.arc(fixed, -age_s * speed, -age_s * rate)
            cos, sin = np.cos(then[..., YAW]), np.sin(then[..., YAW])
            x = then[..., X] + cos * m["gnss_x_m"] - sin * m["gnss_y_m"] + slow[0] * state[..., SLOW_X]
            y = then[..., Y] + sin * m["gnss_x_m"] + cos * m["gnss_y_m"] + slow[1] * state[..., SLOW_Y]
            return np.stack([x, y], axis=-1)

        white = (1.0 - m["gnss_slow_share"]) * covariance
        self.update(place - seen(self.mean), _slopes(seen, self.mean), white)

    def update(self, residual: np.ndarray, row: np.ndarray, noise: np.ndarray) -> None:
        spread = row @ self.covariance @ row.T + noise
        gain = np.linalg.solve(spread, row @ self.covariance).T
        kept = np.eye(12) - gain @ row
        self.mean = self.mean + gain @ residual
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T


def _slopes(function: object, state: State) -> np.ndarray:
    """Central differences, all states at once."""
    step = 1e-5 * np.eye(12)
    high, low = function(state + step), function(state - step)  # type: ignore[operator]
    return np.asarray((high - low) / 2e-5).T
