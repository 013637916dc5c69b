"""Faults in space: lines, blocks, single pixels, uneven light, leaks, by the means of pixels.

Each is fitted to the frames of even number, by the quantity that changes all levels by one amount;
the one that predicts those of odd number best is named and taken out, until none does clearly.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from megalopta.core.arrays import Floats, Ints, Mask, mean_and_variance, robust_sigma
from megalopta.core.quantities import between
from megalopta.sensor.calibrate.pixels import constant_pixels, dead_pixels
from megalopta.sensor.compare.faults import Fault, listed, pixels_of
from megalopta.sensor.compare.in_time import remove_gain
from megalopta.sensor.compare.left import left_of
from megalopta.sensor.compare.residual import LEAK_HZ, Residual


def unresponsive(levels: Sequence[Residual]) -> tuple[Mask, list[Fault]]:
    """Find dead and stuck pixels (rows, columns), and their lines."""
    captured, expected = (
        [getattr(level, side) for level in levels] for side in ("captured", "expected")
    )
    frozen = constant_pixels([level.recorded for level in captured])
    frozen &= ~constant_pixels([level.recorded for level in expected])
    counts, reference = (
        np.sum([level.signal.sum(axis=0, dtype=np.float64) for level in recordings], axis=0)
        for recordings in (captured, expected)
    )
    dead = dead_pixels(counts, reference)
    if dead.mean() > 0.5:  # not pixels count too little, but the array
        dead[:] = False
    silent = dead | frozen
    faults, single = [], silent.copy()
    for name, axis in (("row", 1), ("column", 0)):
        # the fault is the line's, not the pixels'
        lines = silent.mean(axis=axis) > 0.75
        if lines.any() and not lines.all():
            plural = name + ("s" if lines.sum() > 1 else "")
            faults.append(Fault(f"dead {name}", f"dead {plural} {listed(np.flatnonzero(lines))}"))
            single &= ~np.expand_dims(lines, axis)
    if (single & dead).any():
        faults.append(Fault("dead pixel", f"dead {pixels_of(single & dead)}"))
    if (stuck := single & ~dead).any():
        kind = "reading" if captured[0].codes is None else "code"
        at = f"at {kind} {listed(captured[0].recorded[0][stuck])}"
        faults.append(Fault("stuck pixel", f"stuck {pixels_of(stuck)}, {at}"))
    return silent, faults


def deviations(level: Residual, first: int = 0, step: int = 1) -> tuple[Floats, Floats]:
    """Means of good pixels less the robust parabola through expected ones, and their errors.

    Counts (rows, columns), of every so many-th captured frame.
    """
    good = level.good
    means, squares = [], np.square(np.broadcast_to(level.error, good.shape)).astype(float)
    for signal in (level.captured.signal[first::step], level.expected.signal):
        mean, variance = mean_and_variance(signal)
        frames = len(signal) / level.inflation
        squares += np.maximum(variance, mean.clip(0)) / frames + 1 / frames**2
        means.append(mean)
    difference, sigma = means[0] - means[1], np.sqrt(squares)
    # of drawn frames, chance would correlate the difference with what it is compared to; the model
    # does not know what the readout does to them
    known = means[1].clip(0) if level.readout else level.parts["step"]
    scale = max(float(known.max()), 1e-12)
    # the four neighbors, whose crosstalk is no fault of a pixel; 0 beyond the border
    wide = np.pad(known, 1)
    neighbors = wide[:-2, 1:-1] + wide[2:, 1:-1] + wide[1:-1, :-2] + wide[1:-1, 2:]
    columns = np.stack(
        [*((known / scale) ** power for power in range(3)), neighbors / scale], axis=-1
    )
    trend = columns @ _robust_fit(columns[good], difference[good], sigma[good])
    # pixels that counted nothing may have counted as much as the trend
    sigma = np.sqrt(squares + np.abs(trend) / len(level.captured.readings))
    return np.where(good, difference - trend, 0), sigma


def _robust_fit(columns: Floats, values: Floats, sigma: Floats) -> Floats:
    """Combination of columns nearest to values, by iterated least squares (Huber's weights)."""
    weight: Floats = 1 / sigma
    solution: Floats = np.zeros(columns.shape[-1])
    for _ in range(5):
        weighted = columns * weight[:, None]
        normal = np.linalg.pinv(weighted.T @ weighted, hermitian=True)
        solution = np.asarray(normal @ (weighted.T @ (values * weight)))
        left = np.abs(values - columns @ solution) / sigma
        weight = np.asarray(1 / sigma / np.sqrt(np.maximum(left, 1)))
    return solution


def _huber(z: Floats) -> Floats:
    """Squares of z, and lines beyond 4 (Huber)."""
    far = np.abs(z)
    return np.asarray(np.where(far < 4, far**2, 8 * far - 16))


_LEAST_GAIN = 30.0
"""Gain of χ² of frames that were not fitted, from which a pattern is real."""
_MOST_PATTERNS = 24


class _Pattern(NamedTuple):
    """Change of one quantity in one part of the array, or by a smooth surface."""

    part: str
    """"row", "column", "block" or "surface"."""
    text: str
    columns: Floats
    """(rows, columns, k) maps that change together"""
    places: tuple[Ints, ...]
    """Rows and columns of its pixels, of many the evenly spaced ones, that are fitted"""
    quantity: str
    """Parameter of the device, as of `Residual.parts`"""
    sizes: Floats = np.zeros(1)
    gain: float = 0.0
    """Gain of χ² of frames that were not fitted"""

    @property
    def surface(self) -> Floats:
        """Change of the quantity, (rows, columns)."""
        return np.asarray(self.columns @ self.sizes)

    def fitted(
        self, levels: Sequence[Residual], halves: Sequence[Sequence[tuple[Floats, Floats]]]
    ) -> "_Pattern":
        """Fit the sizes to one half of the frames; the gain is the other's."""
        columns: list[list[Floats]] = [[], []]
        values: list[list[Floats]] = [[], []]
        for level, of_level in zip(levels, halves, strict=True):
            good = level.good[self.places]
            use = self.places[0][good], self.places[1][good]
            reach = self.columns[use] * level.parts[self.quantity][use][:, None]
            for half, (counts, error) in enumerate(of_level):
                columns[half].append(reach / error[use][:, None])
                values[half].append(counts[use] / error[use])
        (design, other), (z, seen) = map(np.concatenate, columns), map(np.concatenate, values)
        clear = np.abs(design.T @ z.clip(-4, 4)) > 3 * np.sqrt(np.square(design).sum(axis=0))
        if len(z) < 4 or not clear.any():
            return self._replace(sizes=np.zeros(self.columns.shape[2]))
        sizes = _robust_fit(design, z, np.ones_like(z))
        # a hot pixel is no pattern
        gain = _huber(seen).sum() - _huber(seen - other @ sizes).sum()
        return self._replace(sizes=sizes, gain=float(gain))

    def fault(self, volts_per_count: float) -> Fault:
        """Say which part differs."""
        size, span = float(self.sizes[0]), float(np.ptp(self.surface))
        if self.part == "surface" and self.quantity == "light leak":
            text = f"light leaks in, unevenly, by up to {span * LEAK_HZ:.2g} detections per second"
            return Fault("light leak", text)
        if self.part == "surface":
            text = f"the light is uneven, by {100 * span:.2g} % over the array"
            return Fault("uneven light", text)
        amount = f"{100 * size:+.2g} %"
        if self.quantity == "offset":
            # counts lower the output
            volts = f"{-1e3 * size * volts_per_count:+.2g} mV"
            amount = volts if volts_per_count else f"{size:+.2g} counts"
            if self.part != "block":
                return Fault(f"{self.part} offset", f"{self.text} is offset by {amount}")
        name = {"step": "gain", "dark counts": "dark count rate"}.get(self.quantity, self.quantity)
        return Fault(f"odd {self.part}", f"{name} of {self.text} differs by {amount}")


def _patterns(shape: tuple[int, int], quantities: Sequence[str]) -> list[_Pattern]:
    """Quantities of parts that a readout treats alike, and smooth surfaces of light."""
    row, column = np.ogrid[: shape[0], : shape[1]]
    parts = [("block", "the fields of a chessboard", (row + column) % 2 == 0)]
    for name, index, side in (("row", row, shape[0]), ("column", column, shape[1])):
        parts += [(name, f"{name} {line}", index == line) for line in range(side)]
        parts += [
            ("block", f"even {name}s", index % 2 == 0),
            ("block", f"odd {name}s", index % 2 == 1),
        ]
        for pieces in (2, 4):
            for start, end in pairwise((side * np.arange(pieces + 1) // pieces).tolist()):
                text = f"{name}s {start} to {end - 1}"
                parts.append(("block", text, (index >= start) & (index < end)))
    for pieces in (2, 4):
        tall, wide = max(shape[0] // pieces, 1), max(shape[1] // pieces, 1)
        for down, right in np.ndindex(pieces, pieces):
            inside = (row // tall == down) & (column // wide == right)
            text = f"a block of {tall} × {wide} pixels from ({down * tall}, {right * wide})"
            parts.append(("block", text, inside))
    patterns = []
    for part, text, inside in parts:
        columns, places = np.broadcast_to(inside, shape)[:, :, None], _places(inside, shape)
        patterns += [_Pattern(part, text, columns, places, quantity) for quantity in quantities]
    everywhere = _places(np.ones((1, 1), np.bool_), shape)
    y, x = np.meshgrid(*(np.linspace(-1, 1, side) for side in shape), indexing="ij")
    rough = np.stack((x, y, x * y, x**2, y**2), axis=-1)
    waves = [
        np.cos(np.pi * down * (y + 1) / 2) * np.cos(np.pi * right * (x + 1) / 2)
        for down, right in np.ndindex(*(min(7, side // 2) for side in shape))  # cosines each way
    ]
    for shapes in (rough, np.stack(waves[1:], axis=-1)):
        shapes = shapes - shapes.mean(axis=(0, 1))
        for quantity in ("light leak", "efficiency"):
            patterns.append(_Pattern("surface", "", shapes, everywhere, quantity))
    return patterns


def _places(mask: Mask, shape: tuple[int, int]) -> tuple[Ints, ...]:
    """Rows and columns of marked pixels; of many, every so many-th, by an odd number."""
    flat = np.flatnonzero(np.broadcast_to(mask, shape))
    return np.unravel_index(flat[:: flat.size // 2**13 | 1], shape)  # pixels fitted


def check_patterns(
    levels: Sequence[Residual], least_gain: float = 0.0
) -> tuple[list[Fault], float]:
    """Name the parts of the array that differ, and take them out; return the gain of χ², too."""
    if not any(level.good.sum() > 50 for level in levels):
        return [], 0.0
    is_dark = {level.captured.is_dark for level in levels}
    quantities = ["offset", "step", *["efficiency"] * (False in is_dark)]
    quantities += ["dark counts"] * (True in is_dark)
    candidates = _patterns(levels[0].masked.shape, quantities)
    accepted: list[_Pattern] = []
    others: list[Fault] = []
    while len(accepted) < _MOST_PATTERNS and any(level.good.any() for level in levels):
        halves = [[deviations(level, half, 2) for half in (0, 1)] for level in levels]
        fits = [pattern.fitted(levels, halves) for pattern in candidates]
        best = max(fits, key=lambda fit: fit.gain)
        # a simple part rather than a surface that is little better
        simple = max(fits, key=lambda fit: fit.gain * (fit.part != "surface"))
        best = simple if simple.gain > 0.85 * best.gain - 10 else best
        size = float(np.ptp(np.append(best.surface, 0.0)))
        least_size = 0.02 if best.quantity == "offset" else 0.005
        if best.gain < max(_LEAST_GAIN, least_gain) or size < least_size:
            break
        if accepted and best.gain < 0.03 * accepted[0].gain:  # the first may leave it
            break
        if best.quantity == "offset":
            # a line of which one cannot tell is odd
            same = [fit for fit in fits if fit.columns is best.columns and fit.quantity != "offset"]
            rival = max(same, key=lambda fit: fit.gain)
            best = rival if rival.gain > best.gain - 9 else best
        if sum(fit.columns is best.columns for fit in accepted) > 1:
            others.append(Fault("none", f"{best.part}s do not explain the means of pixels"))
            break
        accepted.append(best)
        others += _take_out(best, levels)
    volts = levels[0].model.volts_per_count if levels[0].captured.codes is not None else 0.0
    named = [fit.fault(volts) for fit in accepted]
    return named + others, sum(fit.gain for fit in accepted)


def _take_out(pattern: _Pattern, levels: Sequence[Residual]) -> list[Fault]:
    """Undo what a pattern does, and mask a small part; say if it is not all that differs there."""
    others = []
    surface, quantity = pattern.surface, pattern.quantity
    inside = pattern.columns[:, :, 0] > 0
    is_small = pattern.part != "surface" and inside.mean() < 0.2
    for number, level in enumerate(levels):
        if not is_small:
            for doubted in (quantity, *["dark counts"] * (quantity == "light leak")):
                level.doubt(doubted, 1.0)  # large: a large part changes it too
        if quantity == "offset":
            level.subtract(surface.astype(np.float32))
        elif quantity == "step":
            remove_gain(level, surface)
        else:
            of_one: Floats | float = LEAK_HZ
            if quantity == "efficiency":
                of_one = level.rate_hz
            elif quantity == "dark counts":
                of_one = level.parts[quantity] / level.expected.exposure_s
            level.rate_hz = np.maximum(level.rate_hz + surface * of_one, 0.0)
            level.redraw(100 + number)
        if is_small:
            if left_of(replace(level, masked=level.masked | ~inside), ("bit",)):
                others.append(Fault("none", f"{pattern.text} differ in other ways, too"))
            level.masked = level.masked | inside
    return others


def odd_pixels(levels: Sequence[Residual]) -> tuple[Mask, list[Fault]]:
    """Mark and describe single pixels that deviate by 8 σ and a tenth of their mean."""
    hot, odd, less = np.zeros((3, *levels[0].masked.shape), np.bool_)
    dark_hz = np.zeros(hot.shape)
    for level in levels:
        counts, error = deviations(level)
        z = (counts / error)[level.good]
        scatter = max(robust_sigma(z), 1.0) if z.size else 1.0
        far = level.good & (np.abs(counts) > 8.0 * scatter * error)
        far &= np.abs(counts) > 0.1 * np.maximum(level.expected_mean, 0)
        odd |= far
        less |= counts < 0
        if level.captured.is_dark:
            hot |= far & (counts > level.parts["dark counts"])
            dark_hz = level.captured.signal.mean(axis=0) / level.captured.exposure_s
    # beyond 2 % of all, they are no single ones
    if odd.sum() > max(0.02 * odd.size, 6):
        return np.zeros_like(odd), []
    less &= odd & ~hot
    if hot.any() and less.any():
        # as if pixels had changed places
        text = f"{pixels_of(hot)} count more, and {pixels_of(less)} less"
        return hot | odd, [Fault("none", text)]
    faults = []
    if hot.any():
        rates = between(dark_hz[hot].min(), dark_hz[hot].max(), "Hz")
        faults.append(Fault("hot pixel", f"hot {pixels_of(hot)}, of {rates}"))
    if (odd & ~hot).any():
        text = f"{pixels_of(odd & ~hot)} differ in their mean from all others"
        faults.append(Fault("deviating pixel", text))
    return odd, faults
