import numpy as np


def bits(frames, rows, columns, seed=0):
    """Binary frames of a smooth picture, 0 and 1, uint8."""
    y, x = np.mgrid[:rows, :columns]
    p = 0.35 + 0.25 * np.sin(x / 60) * np.cos(y / 45) + 0.1 * x / columns
    return (np.random.default_rng(seed).random((frames, rows, columns)) < p).astype(np.uint8)
