"""The survey of host-tools/solver/benches/survey.rs by SciPy, from the problem it prints:

    SURVEY_CSV=1 cargo bench -p nova-solver --bench survey | python3 benches/peers/survey.py

Same model (places, biases, lag, slope, Cauchy loss, priors), analytic Jacobian, cubic through the
track, same width of the loss from wide to narrow: as somebody who knows SciPy would write it. It gives no
doubt, no mirror image and no verdict.
"""

import os
import sys
import time

# One core for everybody, before NumPy loads its BLAS: left to itself on a busy machine of two cores it
# took 16 times as long.
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares

ROWS = [line.strip().split(",") for line in sys.stdin if line[:2] in ("r,", "t,")]
RANGES = np.array([[float(v) for v in row[1:]] for row in ROWS if row[0] == "r"])
TRACK = np.array([[float(v) for v in row[1:]] for row in ROWS if row[0] == "t"])
COUNT = int(RANGES[:, 0].max()) + 1
SIGMA = np.hypot(0.05, 0.02)


def solve():
    path = CubicSpline(TRACK[:, 0], TRACK[:, 1:])
    speed = path.derivative()
    which, t, measured = RANGES[:, 0].astype(int), RANGES[:, 1], RANGES[:, 2]
    rows = np.arange(len(t))

    def parts(x):
        anchors = x[:-2].reshape(COUNT, 4)
        away = path(t - x[-2]) - anchors[which, :3]
        distance = np.linalg.norm(away, axis=1)
        return anchors, away / distance[:, None], distance

    def residuals(x, width):
        anchors, _, distance = parts(x)
        r = ((1 + x[-1]) * distance + anchors[which, 3] - measured) / (SIGMA * width)
        return np.concatenate([r, anchors[:, 3] / 0.3, [x[-2] / 0.5, x[-1] / 0.005]])

    def jacobian(x, width):
        _, u, distance = parts(x)
        j = np.zeros((len(t) + COUNT + 2, len(x)))
        for axis in range(3):
            j[rows, 4 * which + axis] = -(1 + x[-1]) * u[:, axis] / (SIGMA * width)
        j[rows, 4 * which + 3] = 1 / (SIGMA * width)
        j[rows, -2] = -(1 + x[-1]) * np.sum(u * speed(t - x[-2]), axis=1) / (SIGMA * width)
        j[rows, -1] = distance / (SIGMA * width)
        for k in range(COUNT):
            j[len(t) + k, 4 * k + 3] = 1 / 0.3
        j[-2, -2], j[-1, -1] = 1 / 0.5, 1 / 0.005
        return j

    x = np.concatenate([np.tile(np.append(TRACK[:, 1:].mean(axis=0) - [0, 0, 1], 0.0), COUNT), [0.0, 0.0]])
    for width in (50.0, 5.0, 1.0):
        x = least_squares(residuals, x, jac=jacobian, loss="cauchy", f_scale=2.385, args=(width,)).x
    return x


times = []
for _ in range(5):
    begin = time.perf_counter()
    answer = solve()
    times.append(time.perf_counter() - begin)
print(f"SciPy: {1e3 * np.median(times):.1f} ms; lag {answer[-2]:.4f} s, slope {answer[-1]:.5f}")
for k, anchor in enumerate(answer[:-2].reshape(COUNT, 4)):
    print(f"  {k}: {anchor.round(3)}")
