"""Faults of cameras: shares that a comparison names, misnames and misses.

    bench_faults.py [CAMERA ...] [--seeds 0-9] [--side 32] [--pairs 40] [--faults FAULT ...]

Cameras are SPADCAM's codes (16 × 16 pixels), counts (128 × 128) and bits (256 × 256; each frame 0
or 1), with `--side` counts and bits of so many pixels a side. Recordings are of 400 frames in the
dark and under two or three lights. A fault is put into a recording of a known device, which is
compared with that device (`tests/sensor/compare/faulty.py`). "Right" says the fault and nothing
else, "wrong" states another one, too or instead; "none of the known causes", or a drift without its
cause, counts as missed. Of untouched recordings, "wrong" is a false alarm. With `--pairs`, so many
pairs of faults, drawn by chance, are put into one recording each: "right" says one of them or both.
"""

import argparse
import sys
import time
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.sensor.compare.faulty import CAMERAS, FAULTS, compared, said, together

_UNTOUCHED = ("", {})


def verdict(found, wanted, is_pair=False):
    """Whether what a comparison says is right, wrong or too little."""
    vague = {"none"}
    if any(each.startswith("drift") for each in wanted):
        vague |= {"drift of readings", "drift of light or gain"}  # it drifts, and no cause is told
    if found - wanted - vague:
        return "wrong"
    return "right" if found == wanted or (is_pair and found & wanted) else "missed"


def alone(camera, faults, seeds):
    """Compare recordings of one fault each; print a row for each of them."""
    total = Counter()
    for name, (wanted, how) in faults.items():
        score, other, start = Counter(), Counter(), time.process_time()
        for seed in seeds:
            found = compared(seed, camera, **how)
            names = said(found) | ({"alarm"} if not wanted and found.alarms else set())
            score[verdict(names, {wanted} - {""})] += 1
            other.update(names - {wanted})
        spent = (time.process_time() - start) / len(seeds)
        row(name, score, f"{spent:6.1f}  {counted(other)}")
        if wanted:
            total += score
    row("all faults", total, "")


def in_pairs(camera, faults, number, seeds):
    """Compare recordings of two faults each, drawn by chance."""
    able = [pair for pair in combinations(faults, 2) if can_meet(*(faults[each] for each in pair))]
    total = Counter()
    chosen = np.random.default_rng(seeds[0]).permutation(len(able))[:number]
    for at, place in enumerate(chosen):
        one, other = (faults[each] for each in able[place])
        names = said(compared(seeds[at % len(seeds)], camera, **together(one[1], other[1])))
        result = verdict(names, {one[0], other[0]}, is_pair=True)
        total[result] += 1
        if result != "right":
            print(f"  {' and '.join(able[place])}: {', '.join(sorted(names)) or 'nothing'}",
                  flush=True)  # fmt: skip
    row("pairs", total, "")


def can_meet(one, other):
    """True for faults of two kinds that do not change the same value."""
    both = set(one[1].get("sensor", ())) & set(other[1].get("sensor", ()))
    return one[0] != other[0] and "none" not in (one[0], other[0]) and not both


def row(name, score, rest):
    numbers = "".join(f"{score[each]:7d}" for each in ("right", "wrong", "missed"))
    print(f"{name:28s}{numbers}{rest}", flush=True)


def counted(names):
    return ", ".join(f"{name} {number}" for name, number in sorted(names.items()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cameras", nargs="*", choices=[*CAMERAS, []], metavar="CAMERA")
    parser.add_argument("--seeds", default="0-0", help="first and last seed")
    parser.add_argument("--side", type=int)
    parser.add_argument("--pairs", type=int, default=0)
    parser.add_argument("--faults", nargs="*", default=())
    options = parser.parse_args()
    first, _, last = options.seeds.partition("-")
    seeds = range(int(first), int(last or first) + 1)
    for name in options.cameras or CAMERAS:
        camera = CAMERAS[name]
        if options.side and not camera.has_codes:
            camera = camera._replace(shape=(options.side, options.side))
        print(f"{f'{name}, {camera.shape}':28s}  right  wrong missed CPU s  said else")
        faults = {"untouched": _UNTOUCHED, **FAULTS[name]}
        if options.pairs:
            in_pairs(camera, FAULTS[name], options.pairs, seeds)
        else:
            alone(camera, {k: v for k, v in faults.items() if k in options.faults}
                  if options.faults else faults, seeds)  # fmt: skip


if __name__ == "__main__":
    main()
