"""Comparisons of faults composed at random: right, "none", vague, silent and wrong.

The cameras, the faults and what is right are those of `tests/sensor/compare/composed.py`. Each of
`--faults` recipes is drawn at three strengths; of pairs, each of two recipes, half of them middle
and half strong. Intervals are Wilson's, 95 %. Seeds below 1000 and two thirds of the recipes are
for development; `--judging` draws the other third with seeds from 1000 on, and shows no examples.
"""

import argparse
import os
import sys
import time
from collections import Counter, defaultdict
from multiprocessing import get_context
from pathlib import Path

import numpy as np

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(name, "1")
sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.sensor.compare import composed  # noqa: E402

OUTCOMES = "right", "none", "wrong", "vague", "silent"


def run(task):
    """Outcome of a comparison: group, faults, strength, seed, verdict, names, CPU seconds."""
    group, faults, strength, seed = task
    start = time.process_time()
    if group == "identical":
        found = composed.compared(faults, (), 0, seed)
        outcome, named = ("alarm" if found.alarms else "quiet"), composed.said(found)
    else:
        try:
            outcome, named = composed.verdict(faults, strength, seed)
        except Exception as error:
            outcome, named = "wrong", {f"{type(error).__name__}: {error}"}
    return (*task, outcome, named, time.process_time() - start)


def interval(successes, trials):
    """Wilson's 95 % interval of a share, %."""
    z, n = 1.96, max(trials, 1)
    share = successes / n
    middle = (share + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * np.sqrt(share * (1 - share) / n + z**2 / (4 * n**2))
    return f"{100 * max(middle - half, 0):.0f}-{100 * min(middle + half, 1):.0f} %"


def row(title, outcomes):
    """Return a line of the table in docs/how-to/spadcam.md: counts, and the share without error."""
    counts, n = Counter(outcomes), len(outcomes)
    kept = counts["right"] + counts["none"]
    cells = *(counts[name] for name in OUTCOMES), f"{100 * kept / n:.0f} % ({interval(kept, n)})"
    return f"| {n} {title} | {' | '.join(map(str, cells))} |"


def tasks(arguments):
    """Comparisons to make."""
    first = 1000 if arguments.judging else 0
    first += arguments.seed

    def drawn(number, camera=""):
        return composed.compose(number, reserved=arguments.judging, camera=camera)

    made = []
    for number in range(first, first + arguments.faults):
        faults = (drawn(number),)
        made += [("single", faults, strength, number) for strength in range(3)]
    for number in range(first, first + arguments.pairs):
        one = drawn(10_000 + number)
        made.append(("pair", (one, drawn(20_000 + number, one.camera)), 1 + number % 2, number))
    cameras = list(composed.CAMERAS)
    for number in range(first, first + arguments.identical):
        made.append(("identical", cameras[number % 3], 0, number // 3 + 10**5))
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name, count in (("faults", 12), ("pairs", 6), ("identical", 12), ("seed", 0), ("jobs", 1)):
        parser.add_argument(f"--{name}", type=int, default=count)
    parser.add_argument("--judging", action="store_true")
    parser.add_argument("--examples", action="store_true", help="what was not right")
    arguments = parser.parse_args()
    with get_context("spawn").Pool(arguments.jobs) as pool:
        results = []
        for result in pool.imap(run, tasks(arguments)):
            results.append(result)
            group, faults, strength, seed, outcome, named, _ = result
            if arguments.examples and outcome in ("vague", "silent", "wrong", "alarm"):
                label = faults if group == "identical" else ["/".join(fault) for fault in faults]
                print(outcome, label, strength, seed, sorted(named), flush=True)
    groups = defaultdict(list)
    for group, faults, strength, *_, outcome, _, _ in results:
        if group == "identical":
            groups["identical"].append(outcome)
            continue
        groups[group, "all"].append(outcome)
        if group == "single":
            groups["strength", composed.STRENGTHS[strength]].append(outcome)
            groups["camera", faults[0].camera].append(outcome)
            groups["what", faults[0].what].append(outcome)
    print("| recordings | right | none | wrong | vague | silent | right or none |")
    print("|---|---|---|---|---|---|---|")
    alarms = groups.pop("identical", [])
    for title, outcomes in sorted(groups.items()):
        print(row(", ".join(title), outcomes))
    print(f"identical devices: {len(alarms)}, alarms: {alarms.count('alarm')}")
    print(f"{np.mean([result[-1] for result in results]):.1f} CPU-s a comparison")


if __name__ == "__main__":
    main()
