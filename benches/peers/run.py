"""Runs the same problems through this project and through Python peers, and prints medians and ratios.

    python benches/peers/run.py

builds what it needs with cargo. `--seconds` sets how long each method is repeated on each problem.
"""

import os

# One core for everybody, before NumPy loads its BLAS.
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import argparse
import importlib
import json
import pathlib
import subprocess
import sys
import tempfile
import time

import numpy as np

sys.dont_write_bytecode = True

import map_batch
import multilateration
import nova_loop

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROBLEMS = {
    "multilateration": ("Multilateration, 200 ranges, warm start", multilateration),
    "nova": ("The paper's joint optimisation, one solve", nova_loop),
    "map": ("Maximum a posteriori, one update in a flight of a minute", map_batch),
    "target": ("A moving target, one of the last 500 of 1000 sightings", None),
    "program": ("Standoff controller's quadratic program, set up and solved", None),
}
# Kinds without a module need packages that not everybody has: imported when their turn comes.


def build():
    """Path of our program, freshly built."""
    command = ["cargo", "build", "--release", "-p", "nova-solver", "--example", "peers",
               "--message-format=json-render-diagnostics"]
    done = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    messages = (json.loads(line) for line in done.stdout.splitlines())
    programs = [m["executable"] for m in messages if m.get("executable")]
    return programs[-1]


def ours(program, kind, lines):
    with tempfile.NamedTemporaryFile("w", suffix=".txt") as file:
        file.write("\n".join(lines))
        file.flush()
        done = subprocess.run([program, kind, file.name], stdout=subprocess.PIPE, text=True,
                              check=True)
    return {outcome["name"]: outcome for outcome in json.loads(done.stdout)}


def timed(call, seconds):
    """All times in microseconds that so many seconds of calls yield, at least 2; the last answer."""
    call()
    times = []
    begin = time.perf_counter()
    while len(times) < 2 or time.perf_counter() - begin < seconds:
        took, answer = call()
        times += took
    return 1e6 * np.array(times), answer


def compare(program, kind, title, module, problems, seconds):
    if module is None:
        try:
            module = importlib.import_module(kind)
        except ImportError as missing:
            print(f"\n{title}: left out, {missing}")
            return
    rows = {}
    for seed in range(problems):
        problem = module.problem(seed)
        outcomes = ours(program, kind, module.lines(*problem, seconds))
        for name, counterpart, call in module.solvers(*problem):
            times, answer = timed(call, seconds)
            mine = outcomes[counterpart]
            rows.setdefault(name, []).append({
                "their median": np.median(times),
                "our median": mine["median_us"],
                "their mean": np.mean(times),
                "their p99": np.percentile(times, 99),
                "our mean": mine["mean_us"],
                "our p99": mine["p99_us"],
                "apart": np.linalg.norm(np.asarray(answer) - np.asarray(mine["answer"])),
            })

    print(f"\n{title}: medians over {problems} problems")
    print(f"{'':38}{'median':>11}{'ours':>11}{'ratio':>7}{'mean':>12}{'ours':>11}{'ratio':>7}"
          f"{'p99':>11}{'ours':>11}{'ratio':>7}{'answers apart':>15}")
    for name, found in rows.items():
        at = {key: float(np.median([one[key] for one in found])) for key in found[0]}
        print(f"{name:38}{length(at['their median'])}{length(at['our median'])}"
              f"{at['their median'] / at['our median']:7.1f} {length(at['their mean'])}"
              f"{length(at['our mean'])}{at['their mean'] / at['our mean']:7.1f}"
              f"{length(at['their p99'])}{length(at['our p99'])}"
              f"{at['their p99'] / at['our p99']:7.1f}{at['apart']:13.1e}", flush=True)


def length(microseconds):
    if microseconds < 1e3:
        return f"{microseconds:8.1f} us"
    return f"{1e-3 * microseconds:8.2f} ms"


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--problems", type=int, default=10, help="random problems of each kind")
    parser.add_argument("--seconds", type=float, default=0.2,
                        help="repetition of each method on each problem")
    parser.add_argument("--only", choices=PROBLEMS, help="one kind alone")
    arguments = parser.parse_args()
    program = build()
    for kind, (title, module) in PROBLEMS.items():
        if arguments.only in (None, kind):
            compare(program, kind, title, module, arguments.problems, arguments.seconds)


if __name__ == "__main__":
    main()
