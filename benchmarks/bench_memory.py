"""Peak memory of every stage against the number of frames: what grows, and by how much.

Each stage runs in a process of its own on a grating of 96 × 96 px. The reference is the same stage
on the shortest sequence; the ratio of bytes is 1 where memory is flat, and the last column is what
a frame adds.
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

FRAMES = (48, 192, 768)
PIXELS = 96 * 96
SETTINGS = {
    "camera.width": 96,
    "camera.height": 96,
    "render.samples_per_pixel": 4,
    "trajectory.rotation_deg_s": 2,
    "light_levels": "[full_moon]",
    "sensors": "[ideal]",
    "benchmark.sizes": "[60]",
    "benchmark.fluxes_per_decade": 1,
    "benchmark.repeats": 2,
}
RUN = """
import json, resource, sys
from megalopta.config.model import load
from megalopta.stages.pipeline import run_stage
root, stage, settings = sys.argv[1], sys.argv[2], json.loads(sys.argv[3])
run_stage(root, load("grating", settings), stage)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


def peak_bytes(root: Path, stage: str, frames: int) -> int:
    settings = {key: str(value) for key, value in SETTINGS.items()}
    settings["trajectory.frames"] = str(frames)
    command = [sys.executable, "-c", RUN, str(root), stage, json.dumps(settings)]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return int(done.stdout.split()[-1])


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        print(f"{'stage':<7} {'frames':>7} {'MB':>6} {'ratio':>6} {'bytes/pixel/frame':>18}")
        for stage in ("render", "sense", "flow", "bench"):
            first = 0
            for frames in FRAMES:
                peak = peak_bytes(Path(folder) / str(frames), stage, frames)
                first = first or peak
                more = frames - FRAMES[0]
                each = f"{(peak - first) / more / PIXELS:.2f}" if more else ""
                print(f"{stage:<7} {frames:>7} {peak / 1e6:>6.0f} {peak / first:>6.2f} {each:>18}")


if __name__ == "__main__":
    main()
