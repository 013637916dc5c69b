"""Light between rendered frames: a texture that drifts, hidden places, places that enter."""

from collections.abc import Iterator

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor import sub_frames
from megalopta.sensor.selfcheck.comparison import Row, exact_row

_SHAPE = 48, 64
_DRIFTS = ((2.0, 0.0), (-1.5, 2.5))
_PARTS = 4


def check_sub_frames() -> Iterator[Row]:
    """Planes, which bilinear interpolation keeps, drifted; and light that is hidden."""
    for right, down in _DRIFTS:
        frames = np.stack([_plane(right * t, down * t) for t in range(2)])
        flow = np.broadcast_to(np.array([right, down]), (1, *_SHAPE, 2))
        found = sub_frames(frames, flow, _PARTS)[0]
        off = 0.0
        for part in range(_PARTS):
            share = (part + 0.5) / _PARTS
            error = found[part] - _plane(right * share, down * share)
            off = max(off, float(np.abs(error[4:-4, 4:-4]).max()))
        yield exact_row("light between frames", f"error, drift {right}, {down} px", 0, off, 1e-9)
    frames = np.stack((np.full(_SHAPE, 1.0), np.full(_SHAPE, 9.0)))
    hidden = np.zeros((1, *_SHAPE), np.bool_)
    hidden[0, :, :32] = True
    gone, seen = np.split(sub_frames(frames, np.zeros((1, *_SHAPE, 2)), 1, hidden)[0, 0], 2, axis=1)
    yield exact_row("light between frames", "hidden in the next", 1, float(gone.mean()), 1e-12)
    yield exact_row("light between frames", "half way", 5, float(seen.mean()), 1e-12)
    yield from _check_borders(frames)
    yield from _check_zoom()


def _check_borders(frames: Floats) -> Iterator[Row]:
    """What leaves is of the frame before, what enters of the next one."""
    flow = np.broadcast_to(np.array([8.0, 0.0]), (1, *_SHAPE, 2))
    found = sub_frames(frames, flow, 2)[0]
    for part, share in enumerate((0.25, 0.75)):
        enters, leaves = round(8 * share), round(8 * (1 - share))
        expected = np.full(_SHAPE[1], 1 + 8 * share)
        expected[:enters] = 9.0
        expected[_SHAPE[1] - leaves :] = 1.0
        off = float(np.abs(found[part] - expected).max())
        yield exact_row("light between frames", f"borders at {share:g}", 0, off, 1e-9)


def _check_zoom() -> Iterator[Row]:
    """Flow that grows from pixel to pixel: x becomes x·(1 + k), as do its surroundings."""
    zoom = 0.05
    frames = np.stack([_zoomed(1.0), _zoomed(1 + zoom)])
    flow = zoom * np.indices(_SHAPE)[::-1].transpose(1, 2, 0)
    found = sub_frames(frames, flow[None], _PARTS)[0]
    for part in range(_PARTS):
        share = (part + 0.5) / _PARTS
        error = (found[part] - _zoomed(1 + share * zoom))[4:-4, 4:-4]
        # the flow of a point is found in three steps: (a·k)⁴ of 60 px remains
        yield exact_row(
            "light between frames", f"error, zoom, at {share:g}", 0, np.abs(error).max(), 5e-4
        )


def _zoomed(by: float) -> Floats:
    y, x = np.indices(_SHAPE)
    return np.asarray(100 + (0.7 * x - 1.1 * y) / by)


def _plane(right: float, down: float) -> Floats:
    y, x = np.indices(_SHAPE)
    return np.asarray(100 + 0.7 * (x - right) - 1.1 * (y - down))
