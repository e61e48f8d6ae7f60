"""The controller's quadratic program by OSQP: the acceleration nearest to a reference, in a box, with its
part along the line of sight between two limits.

OSQP stops at residuals of 1e-3 unless told otherwise; here both are timed, that and 1e-9 with polishing.
Setting up is part of the time, as the matrix changes with the line of sight.
"""

import time

import numpy as np
import osqp
from scipy import sparse

OBJECTIVE = sparse.identity(3, format="csc")


def problem(seed, count=200):
    """Programs whose barrier cuts off the reference: reference, sight, least and most along it, box."""
    rng = np.random.default_rng(seed)
    rows = []
    while len(rows) < count:
        reference = rng.uniform(-6.0, 6.0, 3)
        sight = rng.standard_normal(3)
        sight /= np.linalg.norm(sight)
        velocity = rng.uniform(-3.9, 3.9, 3)
        low = np.clip((-4.0 - velocity) / 0.05, -4.0, 4.0)
        high = np.clip((4.0 - velocity) / 0.05, -4.0, 4.0)
        reach = np.where(sight > 0.0, low, high) @ sight, np.where(sight > 0.0, high, low) @ sight
        least, most = np.sort(rng.uniform(*reach, 2))
        if least + 0.1 < most and not least < sight @ np.clip(reference, low, high) < most:
            rows.append((*reference, *sight, least, most, *low, *high))
    return (rows,)


def lines(rows, seconds):
    def row(word, *numbers):
        return word + " " + " ".join(repr(float(v)) for v in numbers)

    yield row("seconds", seconds)
    for program in rows:
        yield row("program", *program)


def solve_all(rows, **settings):
    times, found = [], []
    for row in rows:
        row = np.array(row)
        begin = time.perf_counter()
        solver = osqp.OSQP()
        limits = sparse.csc_matrix(np.vstack([row[3:6], np.eye(3)]))
        solver.setup(OBJECTIVE, -row[:3], limits, np.append(row[6], row[8:11]),
                     np.append(row[7], row[11:14]), verbose=False, **settings)
        solution = solver.solve()
        times.append(time.perf_counter() - begin)
        found.append(solution.x)
    return times, np.concatenate(found)


def solvers(rows):
    exact = {"eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 100_000, "polishing": True}
    yield "OSQP as it comes", "clarabel", lambda: solve_all(rows)
    yield "OSQP to 1e-9, polished", "clarabel", lambda: solve_all(rows, **exact)
