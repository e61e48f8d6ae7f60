"""A place from 200 ranges, from a warm start: SciPy's least_squares on the whitened residuals."""

import time

import numpy as np
from scipy.optimize import least_squares

CAUCHY_95 = 2.385
NODE = np.array([7.0, -3.0, 0.5])
SIGMA_M = 0.05


def problem(seed):
    """A winding flight with Gaussian ranges, and a guess half a metre off."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 12.0, 200, endpoint=False)
    places = np.column_stack([s, 4.0 * np.sin(s), 5.0 + 2.0 * np.cos(0.7 * s)])
    ranges = np.linalg.norm(places - NODE, axis=1) + SIGMA_M * rng.standard_normal(len(s))
    offset = rng.standard_normal(3)
    guess = NODE + 0.4 * offset / np.linalg.norm(offset)
    return places, ranges, guess


def lines(places, ranges, guess, seconds):
    yield f"seconds {seconds!r}"
    yield "guess " + " ".join(repr(float(v)) for v in guess)
    for i, (place, distance) in enumerate(zip(places, ranges)):
        numbers = [0.1 * i, *place, distance, SIGMA_M]
        yield "range " + " ".join(repr(float(v)) for v in numbers)


def solvers(places, ranges, guess):
    """(name, which of ours it is compared with, call that returns its times and the place)."""

    def residuals(p):
        d = p - places
        return (np.sqrt(np.einsum("ij,ij->i", d, d)) - ranges) / SIGMA_M

    def jacobian(p):
        d = p - places
        return d / (np.sqrt(np.einsum("ij,ij->i", d, d)) * SIGMA_M)[:, None]

    def solver(**options):
        def solve():
            begin = time.perf_counter()
            found = least_squares(residuals, guess, **options)
            return [time.perf_counter() - begin], found.x

        return solve

    cauchy = {"loss": "cauchy", "f_scale": CAUCHY_95}
    return [
        ("SciPy lm, plain", "plain", solver(method="lm")),
        ("SciPy lm, plain, analytic Jacobian", "plain", solver(method="lm", jac=jacobian)),
        ("SciPy trf, Cauchy", "cauchy", solver(**cauchy)),
        ("SciPy trf, Cauchy, analytic Jacobian", "cauchy", solver(jac=jacobian, **cauchy)),
    ]
