"""Pixels a second from a video to counts on disk, beside NumPy's Poisson draws of the same frames.

    python benchmarks/bench_pictures.py [WIDTH HEIGHT FRAMES]

A video of a moving texture is encoded once. `sense` reads it twice, once to measure its light, and
writes counts, with and without their expectation. NumPy draws `rng.poisson` of the same mean
photons from memory and writes nothing. Times are of a whole process less an empty command, medians
of three runs.
"""

import subprocess
import sys
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
from scipy.ndimage import gaussian_filter

_PHOTONS = 2.0
_RUNS = 3


def write_video(path: Path, width: int, height: int, frames: int) -> None:
    import av

    noise = np.random.default_rng(0).standard_normal((height, width + 4 * frames, 3))
    texture = (128 + 900 * gaussian_filter(noise, (2, 2, 0))).clip(0, 255).astype(np.uint8)
    with av.open(str(path), "w") as file:
        stream = file.add_stream("libx264", rate=30, options={"preset": "ultrafast"})
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for index in range(frames):
            shown = np.ascontiguousarray(texture[:, 4 * index : 4 * index + width])
            file.mux(stream.encode(av.VideoFrame.from_ndarray(shown, format="rgb24")))
        file.mux(stream.encode())


def seconds(*words: str) -> float:
    """Median wall time of a command."""
    taken = []
    for _ in range(_RUNS):
        start = time.perf_counter()
        subprocess.run([sys.executable, "-m", "megalopta", *words], check=True, capture_output=True)
        taken.append(time.perf_counter() - start)
    return median(taken)


def numpy_seconds(width: int, height: int, frames: int) -> float:
    """Median wall time of NumPy's draws of as many pixels of a texture."""
    rng, light = np.random.default_rng(0), np.random.default_rng(1).uniform(0, 2, (height, width))
    taken = []
    for _ in range(_RUNS):
        start = time.perf_counter()
        for _ in range(frames):
            rng.poisson(_PHOTONS * light)
        taken.append(time.perf_counter() - start)
    return median(taken)


def main(width: int = 1920, height: int = 1080, frames: int = 90) -> None:
    with TemporaryDirectory() as folder:
        clip = Path(folder) / "clip.mp4"
        write_video(clip, width, height, frames)
        idle = seconds("sense", "--help")
        pixels = 1e-6 * width * height * frames
        reference = pixels / numpy_seconds(width, height, frames)
        print(f"{frames} frames of {width} × {height}; NumPy's Poisson {reference:.1f} Mpx/s")
        for what, stated in ("counts", "false"), ("with expectation", "true"):
            words = ["sense", str(clip), "--photons", f"{_PHOTONS:g}", "--expectation", stated]
            speed = pixels / (seconds(*words, "--out", f"{folder}/out", "--redo") - idle)
            print(f"{what}: {speed:.1f} Mpx/s, {speed / reference:.2f} of NumPy's")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
