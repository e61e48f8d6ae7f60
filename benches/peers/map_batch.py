"""Maximum a posteriori over tag, range bias and dead reckoning's error, as a batch in NumPy.

The model is the one in host-tools/solver/src/map/hypothesis.rs: knots half a second apart with the
Markov prior of ins_error.rs, a range's error linear between its knots, a mixture of Gaussian and
late outliers. An update is two Gauss-Newton steps from the last solution. The normal equations are
banded but for the four unknowns that all ranges share: one banded Cholesky factor with those as
right-hand sides, as somebody who knows SciPy would write it.
"""

import functools
import time

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

TAG = np.array([18.0, 7.0, 0.5])
KNOT_S, STATES = 0.5, 7
# Position, velocity, acceleration of the two horizontal axes.
AXES = ([0, 3, 5], [1, 4, 6])
NOISE = {"velocity": 7.7e-3, "acceleration": 5e-4, "position": 5e-3, "height": 5e-3,
         "range": 0.06, "outliers": 0.02}
PRIOR = {"horizontal": 15.0, "vertical": 15.0, "bias": 0.15, "velocity": 0.01,
         "acceleration": 1e-3, "place": 1e-3}
UPDATE_EVERY = 20  # ranges
STEPS = 2


def problem(seed):
    """A minute's approach and helix at 10 Hz, accelerometer noise, ranges to 5 cm and 3 cm late."""
    rng = np.random.default_rng(seed)
    t = 0.1 * np.arange(1, 601)
    radius = np.maximum(18.0 - 0.6 * t, 0.8)
    angle = 0.3 + np.cumsum(0.1 / np.maximum(radius, 2.0)) * 0.5
    truth = TAG + np.column_stack([radius * np.cos(angle), radius * np.sin(angle), 29.0 - 0.47 * t])
    velocity = np.cumsum(0.007 * np.sqrt(0.1) * rng.standard_normal((600, 2)), axis=0)
    error = np.column_stack([np.cumsum(0.1 * velocity, axis=0),
                             np.cumsum(0.003 * np.sqrt(0.1) * rng.standard_normal(600))])
    ranges = np.linalg.norm(truth - TAG, axis=1) + 0.03 + 0.05 * rng.standard_normal(600)
    direction = rng.uniform(0.0, 2.0 * np.pi)
    guess = TAG + np.array([5.0 * np.cos(direction), 5.0 * np.sin(direction), 3.0])
    return t, truth + error, ranges, guess


def lines(t, reckoned, ranges, guess, seconds):
    def row(word, *numbers):
        return word + " " + " ".join(repr(float(v)) for v in numbers)

    yield row("seconds", seconds)
    yield row("guess", *guess)
    yield row("noise", *NOISE.values())
    yield row("prior", *(PRIOR[k] for k in ("horizontal", "vertical", "bias", "velocity", "acceleration")))
    for sample in zip(t, reckoned, ranges):
        yield row("sample", sample[0], *sample[1], sample[2])


class Batch:
    """All measurements up to a time, and the state that explains them."""

    def __init__(self, guess):
        self.guess = np.append(guess, 0.0)
        self.shared = self.guess.copy()
        self.knots = np.zeros((1, STATES))
        self.times = np.zeros(1)

    def take(self, t, reckoned, ranges):
        """The measurements are these from now on; new knots continue the last one."""
        ends = np.append(np.arange(KNOT_S, t[-1] - 1e-6, KNOT_S), t[-1])
        times = np.append(0.0, ends)
        # The last knot moves with the newest range; those before stand still.
        kept = max(1, len(self.times) - 1)
        knots = np.empty((len(times), STATES))
        knots[:kept] = self.knots[:kept]
        for k in range(kept, len(times)):
            knots[k] = transition(round(times[k] - times[k - 1], 9))[0] @ knots[k - 1]
        self.knots, self.times = knots, times
        self.reckoned, self.ranges = reckoned, ranges
        self.k = np.clip(np.searchsorted(times, t - 1e-9) - 1, 0, len(times) - 2)
        self.part = (t - times[self.k]) / (times[self.k + 1] - times[self.k])

    def step(self):
        """One Gauss-Newton step; how long it was, metres."""
        n = len(self.times)
        band = np.zeros((2 * STATES, n * STATES))  # lower form
        border = np.zeros((n * STATES, 4))
        gradient = np.zeros((n, STATES))
        shared = np.zeros((4, 4))
        self.add_prior(band, gradient, shared)
        shared_gradient = np.diag(shared) * (self.shared - self.guess)
        self.add_transitions(band, gradient)
        shared_gradient += self.add_ranges(band, border, gradient, shared)

        factor = cholesky_banded(band, lower=True)
        right = np.column_stack([border, gradient.ravel()])
        solved = cho_solve_banded((factor, True), right)
        reduced = shared - border.T @ solved[:, :4]
        change = -cho_solve(cho_factor(reduced), shared_gradient - border.T @ solved[:, 4])
        self.shared = self.shared + change
        self.knots = self.knots - (solved[:, 4] + solved[:, :4] @ change).reshape(n, STATES)
        return np.linalg.norm(change[:3])

    def add_prior(self, band, gradient, shared):
        p, v, a = PRIOR["place"], PRIOR["velocity"], PRIOR["acceleration"]
        weight = np.array([p, p, p, v, v, a, a]) ** -2.0
        band[0, :STATES] += weight
        gradient[0] += weight * self.knots[0]
        sigma = [PRIOR["horizontal"]] * 2 + [PRIOR["vertical"], PRIOR["bias"]]
        shared += np.diag(np.array(sigma) ** -2.0)

    def add_transitions(self, band, gradient):
        parts = [transition(dt) for dt in np.round(np.diff(self.times), 9)]
        f, weight = (np.array(matrices) for matrices in zip(*parts))
        back = np.swapaxes(f, 1, 2) @ weight
        misfit = self.knots[1:] - np.einsum("kij,kj->ki", f, self.knots[:-1])
        gradient[:-1] -= np.einsum("kij,kj->ki", back, misfit)
        gradient[1:] += np.einsum("kij,kj->ki", weight, misfit)
        add_blocks(band, back @ f, 0, 0)
        add_blocks(band, weight, 1, 1)
        add_blocks(band, -np.swapaxes(back, 1, 2), 1, 0)

    def add_ranges(self, band, border, gradient, shared):
        k, s = self.k, self.part
        error = (1.0 - s)[:, None] * self.knots[k, :3] + s[:, None] * self.knots[k + 1, :3]
        sight = self.shared[:3] - self.reckoned + error
        distance = np.sqrt(np.einsum("ij,ij->i", sight, sight))
        j = np.column_stack([sight / distance[:, None], np.ones(len(s))])
        residual = distance + self.shared[3] - self.ranges
        variance = np.full_like(distance, NOISE["range"] ** 2)
        weight, slope = likelihood(residual, variance)

        shared += j.T @ (weight[:, None] * j)
        n = len(self.times)
        products = np.einsum("i,ij,ik->ijk", weight, j, j)
        ends = ((0, 1.0 - s), (1, s))
        for row, row_part in ends:
            pulls = np.zeros((n, 3))
            np.add.at(pulls, k + row, (row_part * slope)[:, None] * j[:, :3])
            gradient[:, :3] += pulls
            mixed = np.zeros((n, 3, 4))
            np.add.at(mixed, k + row, row_part[:, None, None] * products[:, :3, :])
            border.reshape(n, STATES, 4)[:, :3, :] += mixed
            for column, column_part in ends[: row + 1]:
                blocks = np.zeros((n - 1, 3, 3))
                np.add.at(blocks, k, (row_part * column_part)[:, None, None] * products[:, :3, :3])
                add_blocks(band, blocks, row, column)
        return j.T @ slope


def likelihood(residual, variance):
    """Weight of the Gauss-Newton term and slope of the cost, as in likelihood.rs."""
    e = NOISE["outliers"]
    gauss = (1.0 - e) * np.exp(-0.5 * residual**2 / variance) / np.sqrt(2.0 * np.pi * variance)
    tail = e * np.where(residual < 0.0, 0.9, 0.1) * np.exp(-np.abs(residual))
    sound = gauss / (gauss + tail)
    weight = sound / variance + (1.0 - sound) / np.maximum(np.abs(residual), 1e-9)
    return weight, weight * residual


@functools.cache
def transition(dt):
    """F and the inverse of Q over dt; nearly all steps have one length."""
    f, q = np.eye(STATES), np.zeros((STATES, STATES))
    v, a, p = (NOISE[name] ** 2 for name in ("velocity", "acceleration", "position"))
    block = (a * np.array([[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2],
                           [dt**3 / 6, dt**2 / 2, dt]])
             + v * np.array([[dt**3 / 3, dt**2 / 2, 0], [dt**2 / 2, dt, 0], [0, 0, 0]])
             + p * np.diag([dt, 0.0, 0.0]))
    for axis in AXES:
        f[axis[0], axis[1]], f[axis[0], axis[2]], f[axis[1], axis[2]] = dt, 0.5 * dt * dt, dt
        q[np.ix_(axis, axis)] = block
    q[2, 2] = NOISE["height"] ** 2 * dt
    return f, np.linalg.inv(q)


def add_blocks(band, blocks, row, column):
    """Adds the square blocks of all intervals k at knots (k + row, k + column), row >= column, to a
    symmetric matrix in lower banded form."""
    size = blocks.shape[1]
    i, j = np.indices((size, size))
    down = STATES * (row - column) + i - j
    lower = down >= 0
    at = STATES * (np.arange(len(blocks))[:, None] + column) + j[lower]
    band[down[lower], at] += blocks[:, lower]


def solve_flight(t, reckoned, ranges, guess):
    """Updates every two seconds: their times in seconds, and tag minus vehicle at the end."""
    batch = Batch(guess)
    times = []
    for end in range(UPDATE_EVERY, len(t) + 1, UPDATE_EVERY):
        begin = time.perf_counter()
        batch.take(t[:end], reckoned[:end], ranges[:end])
        for _ in range(STEPS):
            batch.step()
        times.append(time.perf_counter() - begin)
    for _ in range(20):
        if batch.step() < 1e-6:
            break
    return times, batch.shared[:3] - reckoned[-1] + batch.knots[-1, :3]


def solvers(t, reckoned, ranges, guess):
    return [("NumPy + banded Cholesky, whole flight", "map",
             lambda: solve_flight(t, reckoned, ranges, guess))]
