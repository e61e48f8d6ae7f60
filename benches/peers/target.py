"""A moving target by range and bearing: GTSAM's iSAM2 and Levenberg-Marquardt on the same factors.

Target states are a point and a velocity each; sensor poses are variables held by priors so tight that they
do not move. The motion factor of a white acceleration couples four variables, more than GTSAM's linear
factors take in Python: it is made once from two halves whose common variable is eliminated, which is
exact. Sightings are those that our side reads from the problem's file.
"""

import time

import gtsam
import numpy as np
from gtsam import symbol

STEP_S, RANGE_SIGMA, BEARING_SIGMA, OUTLIER_SIGMA = 0.05, 0.05, np.radians(3.0), np.radians(25.0)
DENSITY, CAUCHY = 0.5, 2.385
OUTLIERS = 0.1


def problem(seed, count=1000):
    """Sightings of a smooth path from a sensor that flies beside it: t, sensor, its turn about the vertical,
    range, azimuth, elevation."""
    rng = np.random.default_rng(seed)
    t = STEP_S * np.arange(count)
    target = np.column_stack([0.8 * t, 3.0 * np.sin(0.4 * t), 1.5 + 0.6 * np.sin(0.25 * t)])
    sensor = np.column_stack([0.8 * t - 3.0, np.cos(0.3 * t), 1.8 + 0.2 * np.sin(0.5 * t)])
    turn = 0.3 * np.sin(0.2 * t)
    rows = []
    for k in range(count):
        offset = target[k] - sensor[k]
        c, s = np.cos(turn[k]), np.sin(turn[k])
        seen = np.array([c * offset[0] + s * offset[1], -s * offset[0] + c * offset[1], offset[2]])
        sigma = OUTLIER_SIGMA if rng.random() < OUTLIERS else BEARING_SIGMA
        azimuth = np.arctan2(seen[1], seen[0]) + sigma * rng.standard_normal()
        elevation = np.arctan2(seen[2], np.hypot(seen[0], seen[1])) + sigma * rng.standard_normal()
        distance = np.linalg.norm(offset) + RANGE_SIGMA * rng.standard_normal()
        rows.append((t[k], *sensor[k], turn[k], distance, azimuth, elevation))
    prior = np.concatenate([target[0] + [0.3, -0.2, 0.1], [0.4, 0.6, 0.07]])
    return rows, prior


def lines(rows, prior, seconds):
    def row(word, *numbers):
        return word + " " + " ".join(repr(float(v)) for v in numbers)

    yield row("seconds", seconds)
    yield row("prior", *prior, 0.5, 1.0)
    yield row("noise", DENSITY, RANGE_SIGMA, BEARING_SIGMA, CAUCHY)
    for sighting in rows:
        yield row("sighting", *sighting)


def motion(k):
    """The factor between states k and k + 1."""
    x, v, y, w, s = (symbol("x", k), symbol("v", k), symbol("x", k + 1), symbol("v", k + 1),
                     symbol("s", k))
    eye, dt = np.eye(3), STEP_S
    half = gtsam.noiseModel.Isotropic.Variance(3, DENSITY * dt**3 / 24.0)
    speed = gtsam.noiseModel.Isotropic.Variance(3, DENSITY * dt)
    zero = np.zeros(3)
    graph = gtsam.GaussianFactorGraph()
    graph.add(gtsam.JacobianFactor(s, eye, x, -eye, v, -0.5 * dt * eye, zero, half))
    graph.add(gtsam.JacobianFactor(y, eye, s, -eye, w, -0.5 * dt * eye, zero, half))
    graph.add(gtsam.JacobianFactor(w, eye, v, -eye, zero, speed))
    order = gtsam.Ordering()
    order.push_back(s)
    _, rest = graph.eliminatePartialSequential(order)
    at = gtsam.Values()
    for key in (x, v, y, w):
        at.insert(key, gtsam.Point3(0, 0, 0))
    factors = []
    for i in range(rest.size()):
        factor = rest.at(i)
        keys = set(factor.keys())
        point = gtsam.Values()
        for key in keys:
            point.insert(key, gtsam.Point3(0, 0, 0))
        factors.append(gtsam.LinearContainerFactor(factor, point))
    return factors


def pieces(rows, prior):
    """Factors and new variables of every step."""
    robust = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY),
        gtsam.noiseModel.Isotropic.Sigma(2, BEARING_SIGMA))
    distance = gtsam.noiseModel.Isotropic.Sigma(1, RANGE_SIGMA)
    held = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
    steps = []
    for k, (_, px, py, pz, turn, range_m, azimuth, elevation) in enumerate(rows):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        x, v, pose = symbol("x", k), symbol("v", k), symbol("p", k)
        sensor = gtsam.Pose3(gtsam.Rot3.Rz(turn), gtsam.Point3(px, py, pz))
        values.insert(pose, sensor)
        graph.add(gtsam.PriorFactorPose3(pose, sensor, held))
        ce = np.cos(elevation)
        direction = gtsam.Unit3(np.array([ce * np.cos(azimuth), ce * np.sin(azimuth),
                                          np.sin(elevation)]))
        graph.add(gtsam.BearingFactor3D(pose, x, direction, robust))
        graph.add(gtsam.RangeFactor3D(pose, x, range_m, distance))
        if k == 0:
            graph.add(gtsam.PriorFactorPoint3(x, prior[:3],
                                              gtsam.noiseModel.Isotropic.Sigma(3, 0.5)))
            graph.add(gtsam.PriorFactorPoint3(v, prior[3:],
                                              gtsam.noiseModel.Isotropic.Sigma(3, 1.0)))
        else:
            for factor in motion(k - 1):
                graph.add(factor)
        steps.append((graph, values, x, v))
    return steps


def incremental(steps, prior, threshold=0.001, skip=1):
    """iSAM2 through all steps: times of update alone, of update, estimate and marginal, the newest state
    after each step, and the newest of all once it has come to rest: an update is one Gauss-Newton
    step, after which the newest state may still be centimetres from where more of them lead."""
    parameters = gtsam.ISAM2Params()
    parameters.setRelinearizeThreshold(threshold)
    parameters.relinearizeSkip = skip
    solver = gtsam.ISAM2(parameters)
    state = np.array(prior)
    updates, wholes, states = [], [], []
    for k, (graph, values, x, v) in enumerate(steps):
        if k > 0:
            state = np.concatenate([state[:3] + STEP_S * state[3:], state[3:]])
        values.insert(x, gtsam.Point3(*state[:3]))
        values.insert(v, gtsam.Point3(*state[3:]))
        begin = time.perf_counter()
        solver.update(graph, values)
        middle = time.perf_counter()
        state = np.concatenate([solver.calculateEstimatePoint3(x), solver.calculateEstimatePoint3(v)])
        solver.marginalCovariance(x)
        end = time.perf_counter()
        updates.append(1e6 * (middle - begin))
        wholes.append(1e6 * (end - begin))
        states.append(state)
    for _ in range(20):
        solver.update()
    rest = np.array(solver.calculateEstimatePoint3(steps[-1][2]))
    return np.array(updates), np.array(wholes), np.array(states), rest


def batch(steps, guess):
    """Levenberg-Marquardt on the whole: the newest state."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for k, (part, fresh, x, v) in enumerate(steps):
        graph.push_back(part)
        pose = symbol("p", k)
        values.insert(pose, fresh.atPose3(pose))
        values.insert(x, gtsam.Point3(*guess[k][:3]))
        values.insert(v, gtsam.Point3(*guess[k][3:]))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-14)
    parameters.setAbsoluteErrorTol(1e-14)
    parameters.setMaxIterations(300)
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    return np.array([np.concatenate([found.atPoint3(x), found.atPoint3(v)])
                     for _, _, x, v in steps])


def solvers(rows, prior):
    def newest(part, *settings):
        def call():
            updates, wholes, _, rest = incremental(pieces(rows, prior), prior, *settings)
            times = updates if part == "update" else wholes
            return (1e-6 * times[len(times) // 2:]).tolist(), rest
        return call

    def whole():
        _, _, states, _ = incremental(pieces(rows, prior), prior)
        steps = pieces(rows, prior)
        begin = time.perf_counter()
        found = batch(steps, states)
        return [time.perf_counter() - begin], found[-1][:3]

    yield "iSAM2, update alone", "whole", newest("update")
    yield "iSAM2, update, estimate, marginal", "whole", newest("all")
    yield "the same, ours with a window of 64", "window", newest("all")
    yield "iSAM2 as it comes, update alone", "loose", newest("update", 0.1, 10)
    yield "LM, all 1000 at once", "exact", whole
