"""The paper's joint optimisation of trajectory and tag in NumPy, with Bayesian optimisation.

The algorithm is the one written down in host-tools/solver/src/nova/joint.rs, with Table II's
parameters. The Gaussian process here keeps one length scale; ours also chooses its scales.
"""

import time

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.special import ndtr

TAG = np.array([18.0, 7.0, 0.5])
PLAN = np.array([[0.0, 0.0, 30.0], [0.0, 0.0, 29.0], [-1.8, 4.7, 29.0], [10.0, 1.0, 29.0],
                 [14.0, 8.0, 29.0], [17.0, 5.0, 29.0], [17.8, 6.5, 29.0]])

BETA_MIN = 0.15
DELTA_M_S = (0.01, 2.0)
EVALUATIONS, SPREAD, CANDIDATES = 25, 8, 128
LENGTH_SCALE, NUGGET = 0.4, 1e-6
MAX_ALTERNATIONS, EPSILON_M = 20, 0.1
ADAM_ITERATIONS, LEARNING_RATE, VELOCITY = 500, 0.1, (0.1, 30.0)
STEP_EVERY = 5  # ranges: 0.5 s at 10 Hz


def problem(seed):
    """Six legs flown truly at 1 m/s with accelerometer noise, ranges to 2 cm, a first guess 5 m off.

    Times, dead reckoning and ranges of each leg at 10 Hz; legs last a whole number of steps.
    """
    rng = np.random.default_rng(seed)
    legs, tick = [], 0
    velocity_error, position_error = np.zeros(2), np.zeros(2)
    for start, goal in zip(PLAN[:-1], PLAN[1:]):
        ticks = STEP_EVERY * max(1, round(2.0 * np.linalg.norm(goal - start)))
        reckoned, ranges = [], []
        for i in range(ticks + 1):
            truth = start + (goal - start) * i / ticks
            error = np.append(position_error, 0.03 * rng.standard_normal())
            reckoned.append(truth + error)
            ranges.append(np.linalg.norm(truth - TAG) + 0.02 * rng.standard_normal())
            if i < ticks:
                position_error = position_error + 0.1 * velocity_error
                velocity_error = velocity_error + 0.0077 * np.sqrt(0.1) * rng.standard_normal(2)
        times = 0.1 * (tick + np.arange(ticks + 1))
        tick += ticks + 1
        legs.append((start, goal, times, np.array(reckoned), np.array(ranges)))
    angle = rng.uniform(0.0, 2.0 * np.pi)
    guess = TAG + np.array([5.0 * np.cos(angle), 5.0 * np.sin(angle), 3.0])
    return legs, guess


def lines(legs, guess, seconds):
    def row(word, *numbers):
        return word + " " + " ".join(repr(float(v)) for v in numbers)

    yield row("seconds", seconds)
    yield row("guess", *guess)
    for k, (start, goal, times, reckoned, ranges) in enumerate(legs):
        yield row("leg", k, *start, *goal)
        for t, place, distance in zip(times, reckoned, ranges):
            yield row("sample", k, t, *place, distance)


class Segment:
    """A leg as the loop works on it: steps half a second apart, and all ranges."""

    def __init__(self, start, goal, times, reckoned, ranges):
        self.start, self.goal = start, goal
        self.weight = 1.0 / max(np.linalg.norm(goal - start), 0.1)
        self.ranges, self.heights = ranges, reckoned[:, 2]
        at = np.arange(0, len(times), STEP_EVERY)
        self.times, self.steps, step_ranges = times[at], reckoned[at], ranges[at]
        self.dt = np.diff(self.times)
        self.velocity = np.diff(self.steps, axis=0) / self.dt[:, None]
        self.range_rate = np.diff(step_ranges) / self.dt
        duration = self.times[-1] - self.times[0]
        self.nominal_velocity = (goal - start)[:2] / duration
        part = (self.times[1:] - self.times[0]) / duration
        self.nominal = start[:2] + part[:, None] * (goal - start)[:2]
        self.places = (times - self.times[0]) / 0.5
        self.track = self.steps.copy()
        self.track[:, :2] += (start - self.steps[0])[:2]
        self.theta = None

    def tune(self, tag, rng):
        """Eqs. 10-12 with parameters that keep the trajectory closest to the plan."""
        away = self.track[1:] - tag
        away /= np.linalg.norm(away, axis=1)[:, None]
        mismatch = np.abs(self.range_rate - np.einsum("ij,ij->i", self.velocity, away))

        def deviation(unit):
            return np.mean(np.sum((self.filtered(decode(unit), mismatch) - self.nominal) ** 2, axis=1))

        self.theta = minimise(deviation, self.theta, rng)
        self.track[0, :2] = self.start[:2]
        self.track[1:, :2] = self.filtered(decode(self.theta), mismatch)

    def filtered(self, theta, mismatch):
        delta, beta_base, _ = theta
        beta = np.maximum(beta_base * np.exp(-mismatch / delta), BETA_MIN)
        velocities = np.empty((len(beta), 2))
        (vx, vy), measured = self.nominal_velocity, self.velocity
        for i, b in enumerate(beta):
            vx += b * (measured[i, 0] - vx)
            vy += b * (measured[i, 1] - vy)
            velocities[i] = vx, vy
        return self.start[:2] + np.cumsum(velocities * self.dt[:, None], axis=0)

    def measured_from(self):
        at = np.arange(len(self.track))
        return np.column_stack([np.interp(self.places, at, self.track[:, 0]),
                                np.interp(self.places, at, self.track[:, 1]), self.heights])


def decode(unit):
    low, high = DELTA_M_S
    return (low * (high / low) ** unit[0], BETA_MIN + (1.0 - BETA_MIN) * unit[1],
            BETA_MIN + (1.0 - BETA_MIN) * unit[2])


def matern(a, b):
    r = np.sqrt(5.0 * np.sum((a[:, None, :] - b[None, :, :]) ** 2, axis=2)) / LENGTH_SCALE
    return (1.0 + r + r * r / 3.0) * np.exp(-r)


def minimise(function, first, rng):
    """Bayesian optimisation over the unit cube: Gaussian process, expected improvement."""
    points = list(rng.random((SPREAD, 3)))
    if first is not None:
        points.insert(0, first)
    values = [function(x) for x in points]
    candidates = rng.random((CANDIDATES, 3))
    while len(points) < EVALUATIONS:
        x, y = np.array(points), np.array(values)
        factor = cholesky(matern(x, x) + NUGGET * np.eye(len(x)), lower=True)
        ones = cho_solve((factor, True), np.ones(len(x)))
        mean = ones @ y / ones.sum()
        weights = cho_solve((factor, True), y - mean)
        variance = max((y - mean) @ weights / len(x), 1e-300)
        across = matern(candidates, x)
        v = solve_triangular(factor, across.T, lower=True)
        sigma = np.sqrt(np.maximum(variance * (1.0 - np.sum(v * v, axis=0)), 1e-300))
        gain = y.min() - (mean + across @ weights)
        z = gain / sigma
        promise = gain * ndtr(z) + sigma * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
        points.append(candidates[np.argmax(promise)])
        values.append(function(points[-1]))
    return points[int(np.argmin(values))]


def fit_tag(segments, tag):
    """Eq. 13 by Adam with its second moment clipped."""
    places = np.vstack([s.measured_from() for s in segments])
    ranges = np.concatenate([s.ranges for s in segments])
    weights = np.concatenate([np.full(len(s.ranges), s.weight) for s in segments])
    x, m, v = tag.copy(), np.zeros(3), np.zeros(3)
    for k in range(1, ADAM_ITERATIONS + 1):
        d = x - places
        distance = np.sqrt(np.einsum("ij,ij->i", d, d))
        gradient = (2.0 * weights * (distance - ranges) / distance) @ d
        m = 0.9 * m + 0.1 * gradient
        v = 0.999 * v + 0.001 * gradient * gradient
        clipped = np.clip(v / (1.0 - 0.999**k), *VELOCITY)
        step = LEARNING_RATE * m / (1.0 - 0.9**k) / (np.sqrt(clipped) + 1e-8)
        x = x - step
        if np.sqrt(step @ step) < 1e-5:
            break
    return x


def solve_flight(legs, guess):
    """A joint optimisation after each leg but the first: their times in seconds, and the last tag."""
    rng = np.random.default_rng(0)
    segments, tag, times = [Segment(*legs[0])], guess, []
    for leg in legs[1:]:
        begin = time.perf_counter()
        segments.append(Segment(*leg))
        for _ in range(MAX_ALTERNATIONS):
            for segment in segments:
                segment.tune(tag, rng)
            before, tag = tag, fit_tag(segments, tag)
            if np.linalg.norm(tag - before) < EPSILON_M:
                break
        times.append(time.perf_counter() - begin)
    return times, tag


def solvers(legs, guess):
    return [("NumPy, Gaussian process + Adam", "nova", lambda: solve_flight(legs, guess))]
