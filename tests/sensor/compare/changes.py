"""Changes of a camera's rates and readings: lag, loss, order, scale, bits, leaks, drifts, noise."""

from collections.abc import Callable

import numpy as np

from .own_cameras import FRAMES, TOP

PARTS = ("half", "quarter", "block", "odd rows", "odd columns", "few rows", "few columns", "pixels")
LINES = {"odd rows": "row", "few rows": "row", "odd columns": "column", "few columns": "column"}


def part_of(where, shape, rng):
    """Mask (rows, columns) of a part of the array."""
    on, (rows, columns) = np.zeros(shape, np.bool_), shape
    middle, at = rows // 2, int(rng.integers(3, rows - 6))
    if where == "whole":
        on[:] = True
    elif where in ("half", "quarter"):
        on[: middle if where == "quarter" else rows, :middle] = True
        on = np.rot90(on, rng.integers(4))
    elif where == "block":
        row, column = rng.integers(0, 4, 2) * (rows // 4)
        on[row : row + rows // 4, column : column + columns // 4] = True
    elif where == "pixels":
        on.ravel()[rng.choice(on.size, 8, replace=False)] = True
    else:
        lines = on if LINES[where] == "row" else on.T
        lines[slice(1, None, 2) if where.startswith("odd") else slice(at, at + 2)] = True
    return on


def moment_of(when, strength, rng):
    """Mask (frames, 1, 1)."""
    frames = np.arange(FRAMES)
    every = (20, 8, 3)[strength]
    on = {
        "always": frames >= 0,
        "from": frames >= FRAMES * rng.uniform(0.3, 0.7),
        "every": frames % every == rng.integers(every),
        "random": rng.random(FRAMES) < (0.03, 0.06, 0.2)[strength],
    }[when]
    on[0] &= when == "always"  # has no frame before
    return on[:, None, None]


# Changes of rates, by capture, mask (frames, rows, columns) and size

_TIME = np.arange(FRAMES)[:, None, None] / FRAMES
PROFILES: dict[str, Callable] = {  # deviate by 1 from their mean; walks about so
    "ramp": lambda rng: np.sqrt(12) * (_TIME - 0.5),
    "warm-up": lambda rng: -np.exp(-_TIME / 0.15) / 0.23,
    "saw-tooth": lambda rng: np.sqrt(12) * ((5 * _TIME + rng.random()) % 1 - 0.5),
    "flicker": lambda rng: np.sqrt(2) * np.sin(2 * np.pi * FRAMES * _TIME / rng.uniform(3, 20)),
    "white": lambda rng: 1.5 * rng.standard_normal((FRAMES, 1, 1)),
    "walk": lambda rng: np.cumsum(rng.standard_normal((FRAMES, 1, 1)), axis=0) / 7,
    "noise of rows": lambda rng: rng.standard_normal((FRAMES, 64, 1)),
    "noise of columns": lambda rng: rng.standard_normal((FRAMES, 1, 64)),
}


def scaled(what):
    """Rates times 1 + size·profile."""
    profile, _, quantity = what.rpartition(" of ")
    if "noise" in what:
        profile, quantity = what, "exposure"

    def change(c, on, size):
        factor = PROFILES[profile](c.rng)[:, : c.shape[0], : c.shape[1]] if profile else 1.0
        factor = np.maximum(1 + size * factor * on, 0)
        name = "scale" if quantity == "exposure" else quantity
        setattr(c, name, getattr(c, name) * factor)

    return change


def _surface(form, is_dark=False, is_dark_only=False):
    """Light that is uneven, or comes without a source, relative to the mean dark count rate."""

    def change(c, on, size):
        y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in c.shape), indexing="ij")
        if not is_dark:
            c.light = c.light * (1 + size * on * form(y, x))
        elif not (is_dark_only and c.light_hz):
            c.dark = c.dark + size * c.maps["dark_counts"].mean() * form(y, x) * on

    return change


def _telegraph(c, on, size):
    state = np.cumsum(c.rng.random((FRAMES, *c.shape)) < 0.05, axis=0) % 2
    c.dark = c.dark + size * state * on / c.exposure_s


def _fired(*places):
    def change(c, on, size):
        c.echoes = [(row, column, size / len(places)) for row, column in places]

    return change


def _assigned(name, value):
    return lambda c, on, size: setattr(c, name, value(getattr(c, name), size))


# Changes of readings r, with those of the frames before, size and capture


def _bits(new):
    """Change of stored numbers; of codes those of the ADC."""

    def values(r, before, size, c):
        top, size = (TOP, size + 2) if c.kind == "codes" else (0, size)
        return abs(top - new(abs(top - r), size))

    return values


def _late(r, before, size, c):
    """Counts that appear in the next frame."""
    return np.rint(size * before) if c.kind == "codes" else c.rng.binomial(before, size)


def _lagging(r, before, size, c):
    """A share of the frame before in place of this one's; of single counts it would leave no trace."""
    if c.kind == "bits":
        return np.where(c.rng.random(r.shape) < size, before, r)
    return np.floor(r + size * (before - r) + c.rng.random(r.shape))


def _running_mean(r, before, size, c):
    total = np.cumsum(np.concatenate((np.repeat(r[:1], size, axis=0), r)), axis=0)
    return (total[size:] - total[:-size] + size // 2) // size


def _swapped(values, low):
    differ = (values >> low ^ values >> low + 3) & 1
    return values ^ (differ << low | differ << low + 3)


def _end(c, sigmas):
    """Reading so many deviations from the mean of the brightest level."""
    mean, deviation = (129, 14) if c.kind == "counts" else (690, 100)
    return int(mean + sigmas * deviation)


def _half_mirrored(r, *_):
    half = r.shape[2] // 2
    return np.dstack((r[:, :, :half][:, :, ::-1], r[:, :, half:]))


RATES: dict[str, Callable] = {
    "leak": _surface(lambda y, x: 1 + 0 * y, True, True),
    "glow of a corner": _surface(lambda y, x: np.exp(-np.hypot(y + 1, x + 1) / 0.4), True),
    "glow of an edge": _surface(lambda y, x: np.exp(-(y + 1) / 0.3), True),
    "gradient": _surface(lambda y, x: (x + y) / 2),
    "vignette": _surface(lambda y, x: 0.33 - (x**2 + y**2) / 2),
    "reflection": _surface(lambda y, x: np.exp(-8 * ((y - 0.3) ** 2 + (x + 0.2) ** 2))),
    "fringes": _surface(lambda y, x: np.sin(9 * x + 3 * y)),
    "telegraph": _telegraph,
    "dead time": _assigned("dead_s", lambda dead_s, size: dead_s * (1 + size)),
    "read noise": _assigned("read_noise_v", lambda volts, size: volts * size),
    "afterpulses": _fired((0, 0)),
    "crosstalk to four": _fired((0, 1), (0, -1), (1, 0), (-1, 0)),
    "crosstalk to the right": _fired((0, 1)),
    "crosstalk along columns": _fired((1, 0), (-1, 0)),
    "crosstalk to corners": _fired((1, 1), (1, -1), (-1, 1), (-1, -1)),
    "crosstalk two away": _fired((0, 2), (0, -2), (2, 0), (-2, 0)),
}
READINGS: dict[str, Callable] = {
    "moved lag": _lagging,
    "added lag": lambda r, *others: r + _late(r, *others),
    "running mean": _running_mean,
    "repeated": lambda r, before, *_: before,
    "merged": lambda r, before, *_: r + before,
    "empty part": lambda r, *_: 0 * r,
    "full part": lambda r, *_: 0 * r + TOP,
    "old part": lambda r, before, *_: before,
    "part of another place": lambda r, *_: np.roll(r, 5, axis=1),
    "order, by one line": lambda r, *_: np.roll(r, 1, axis=1),
    "order, interleaved": lambda r, *_: r[:, np.arange(r.shape[1]).reshape(2, -1).T.ravel()],
    "order, mirrored half": _half_mirrored,
    "order, swapped rows": lambda r, *_: r[:, np.arange(r.shape[1]) ^ 1],
    "copied columns": lambda r, *_: np.roll(r, 1, axis=2),
    "copied rows": lambda r, *_: np.roll(r, 1, axis=1),
    "stuck at 1": _bits(lambda values, bit: values | 1 << bit),
    "stuck at 0": _bits(lambda values, bit: values & ~(1 << bit)),
    "swapped bits": _bits(_swapped),
    "lost bits": _bits(lambda values, bits: values >> bits << bits),
    "clipped": lambda r, before, size, c: np.minimum(r, _end(c, size)),
    "wrapped": lambda r, before, size, c: r % _end(c, size),
    "offset": lambda r, before, size, c: r + size * (6 if c.kind == "codes" else 1),
    "gain": lambda r, before, size, c: np.rint(r * (1 + size)),
}
