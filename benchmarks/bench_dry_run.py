"""What `dataset make --dry-run` tells, against what making the plan then takes.

The plan mixes gratings of 16 and 512 px with forests of 20 and 1000 trees. Both are run as commands
in processes of their own, with a cache of their own and compiled kernels in the user's; the time
compared is that of processors, so that others on the machine do not count. Some minutes.
"""

import os
import re
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

SIZE_REQUIRED, TIME_REQUIRED, SPENT_REQUIRED_S = 0.3, 2.0, 20.0
PLAN = """
sequences: 4
seed: 9  # each of the four scenes once
scenes:
  - {preset: grating, camera: {width: 16, height: 16}}
  - {preset: grating, camera: {width: 512, height: 512}}
  - {preset: demo, scene: {trees: 20}}
  - {preset: demo, scene: {trees: 1000}}
every: {trajectory: {frames: 3}, render: {samples_per_pixel: 8}}
"""
UNITS = {"s": 1, "min": 60, "hours": 3600, "MB": 1e6, "GB": 1e9}


def run(environment: dict[str, str], *words: str) -> tuple[str, float]:
    """What a command prints, and the processor time that it takes (s)."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, "-m", "megalopta", *words]
    done = subprocess.run(command, env=environment, check=True, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.stdout, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        (root / "plan.yaml").write_text(PLAN)
        environment = {**os.environ, "XDG_CACHE_HOME": str(root / "cache")}
        words = "dataset", "make", str(root / "plan.yaml"), "--out", str(root / "made")
        told, spent_s = run(environment, *words, "--dry-run")
        print(told.strip())
        _, made_s = run(environment, *words)
        bytes_ = sum(each.stat().st_size for each in (root / "made").rglob("*") if each.is_file())
    amount, unit = re.search(r"about (\S+) (MB|GB)", told).groups()  # type: ignore[union-attr]
    size = float(amount) * UNITS[unit]
    amount, unit = re.search(r"\((\S+) (\S+) of processor time\)", told).groups()  # type: ignore[union-attr]
    seconds = float(amount) * UNITS[unit]
    print(f"  dry run: {spent_s:.0f} CPU-s (required: {SPENT_REQUIRED_S:.0f})")
    for name, told_, made, needed in (
        ("size, MB", size / 1e6, bytes_ / 1e6, f"within {SIZE_REQUIRED:.0%}"),
        ("time, CPU-s", seconds, made_s, f"a factor of {TIME_REQUIRED:g}"),
    ):
        ratio = told_ / made
        print(
            f"  {name}: told {told_:.0f}, made {made:.0f}, {ratio:.2f} times (required: {needed})"
        )


if __name__ == "__main__":
    main()
