"""Quantities of a scene, and spectra.

A scene has no dark and no uniform light, so its quantities mix those of the device: brightness, and
contrast, the slope of counts over the light that the model expects, which dark counts do not
change. Both are computed and compared block by block, since the scene is the same in both.
"""

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.sensor.calibrate.level import Level
from megalopta.sensor.compare.two_sample import Difference, Quantity, difference

BLOCKS = 20
SEGMENT = 32
"""Frames per segment of a spectrum."""
_BRIGHTNESS = Quantity("brightness", "counts per second")
_CONTRAST = Quantity("contrast", "counts per photon detected")


def scene_differences(
    captured: Level,
    expected: Level,
    light_hz: Floats,
    margin: float,
    errors_hz: Floats | float = 0.0,
) -> tuple[Difference, ...]:
    """Compare brightness and contrast, frame by frame, of the same scene.

    `light_hz` (n, rows, columns): the model's detection rate of always-live pixels; `margin`:
    negligible relative difference; `errors_hz` (rows, columns) or float: standard errors of
    expected rates that come from a calibration.
    """
    good = captured.usable & expected.usable
    blocks = np.array_split(np.arange(len(light_hz)), BLOCKS)
    light = light_hz[:, good]
    own = np.broadcast_to(errors_hz, good.shape)[good]
    unsure = float(np.sqrt(np.square(own).sum())) / max(own.size, 1)
    measures = [(_BRIGHTNESS, unsure, _mean)]
    if light.std() > 1e-6 * light.mean():
        measures.append((_CONTRAST, 0.0, _slope))
    found = []
    for quantity, error, measure in measures:
        a, b = (
            np.array([measure(each.readings[at][:, good], light[at]) for at in blocks])
            / each.exposure_s
            for each in (captured, expected)
        )
        typical = np.full(BLOCKS, b.mean())
        found.append(difference(quantity, a - b + typical, typical, margin, error))
    return tuple(found)


def _mean(counts: Floats, light: Floats) -> float:
    return float(counts.mean())


def _slope(counts: Floats, light: Floats) -> float:
    """Slope of counts over light, by least squares."""
    apart = light - light.mean()
    return float((apart * counts).sum() / max((apart**2).sum(), 1e-300))


def segment_spectra(counts: NDArray[np.floating]) -> Floats:
    """Return the power over frequency of segments of frames, (segments, SEGMENT/2 + 1).

    Mean over the pixels.
    """
    segments = len(counts) // SEGMENT
    pieces = np.asarray(counts[: segments * SEGMENT], np.float64).reshape(segments, SEGMENT, -1)
    transform = np.fft.rfft(pieces - pieces.mean(axis=1, keepdims=True), axis=1)
    return np.asarray(np.square(np.abs(transform)).mean(axis=-1) / SEGMENT)
