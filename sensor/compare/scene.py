"""How two recordings of one moving scene differ, frame by frame of the same sight.

A scene has no dark and no even light, so that what it says of a device is mixed: how bright it is
counted, and how much of its changes arrives in the counts, the slope of counts over the light that
the model expects, which dark counts do not move. Both are of blocks of frames and compared block by
block, since the scene is the same in both.
"""

import numpy as np

from megalopta.core.arrays import Floats
from megalopta.sensor.compare.counted import CountedFrames
from megalopta.sensor.compare.equivalence import Difference, difference
from megalopta.sensor.compare.quantities import BLOCKS


def scene_differences(
    captured: CountedFrames,
    expected: CountedFrames,
    light_hz: Floats,
    margin: float,
    errors_hz: Floats | float = 0.0,
) -> tuple[Difference, ...]:
    """Compare brightness and contrast.

    Parameters
    ----------
    captured, expected : CountedFrames
        Frame by frame of the same sight.
    light_hz : (n, rows, columns)
        What pixels detect of it in the model, were they always live.
    margin : float
        Relative difference that does not matter.
    errors_hz : (rows, columns) or float
        Standard errors of the expected rates, where these are a calibration's.
    """
    good = captured.usable & expected.usable
    blocks = np.array_split(np.arange(len(light_hz)), BLOCKS)
    light = light_hz[:, good]
    own = np.broadcast_to(errors_hz, good.shape)[good]
    unsure = float(np.sqrt(np.square(own).sum())) / max(own.size, 1)
    found = []
    for name, unit, value in (
        ("brightness", "counts per second", _brightness),
        ("contrast", "counts per photon detected", _contrast),
    ):
        if name == "contrast" and not light.std() > 1e-6 * light.mean():
            continue
        a, b = (
            np.array([value(each.counts[at][:, good], light[at]) for at in blocks])
            / each.exposure_s
            for each in (captured, expected)
        )
        typical = np.full(BLOCKS, b.mean())
        error = unsure if name == "brightness" else 0.0
        found.append(difference(name, a - b + typical, typical, unit, margin, unsure=error))
    return tuple(found)


def _brightness(counts: Floats, light: Floats) -> float:
    return float(counts.mean())


def _contrast(counts: Floats, light: Floats) -> float:
    apart = light - light.mean()
    return float((apart * counts).sum() / max((apart**2).sum(), 1e-300))
