"""Blurred noise that slides as a whole: the simplest source of the benchmark."""

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import gaussian_filter, shift

from megalopta.assets_gen import generator
from megalopta.benchmark.clips import SHAPE, TIMES, FlowClip


def sliding_noise(count: int, shape: tuple[int, int] = SHAPE) -> Iterator[FlowClip]:
    """Yield textures that move by up to 2 px a frame."""
    for seed in range(count):
        rng = generator(seed, "sliding noise")
        texture = 1 + gaussian_filter(rng.uniform(-1, 1, shape), 2, mode="wrap")
        velocity = rng.uniform(-2, 2, 2)
        light = [shift(texture, velocity[::-1] * time, mode="grid-wrap") for time in TIMES]
        flow = np.broadcast_to(velocity, (*shape, 2))
        yield FlowClip(f"noise {seed}", np.array(light), flow)
