"""The light of the motion bench: that of the dissertation, or what a recording shows of its own."""

from typing import Any, NamedTuple

from numpy.typing import NDArray
from scipy.optimize import brentq

from megalopta.sensor import Sensor, reading_moments
from megalopta.sensor.spad.fixed_pattern import draw_fixed_pattern

_BRIGHTEST = 1e6


class BenchLight(NamedTuple):
    """Photons that a pixel detects in a frame, on average over the array, without dark counts."""

    open_photons: float
    hidden_photons: float

    def __str__(self) -> str:
        """Say it to people."""
        return (
            f"an open pixel detects {self.open_photons:.3g} photons per frame, a hidden one "
            f"{self.hidden_photons:.3g}"
        )


def fitted_light(counts: NDArray[Any], sensor: Sensor, frames: int) -> BenchLight:
    """Light under which the model of a sensor reads, on average, what a recording has.

    Parameters
    ----------
    counts : (passages · 2 · frames, rows, columns)
        As `cut_passages` cuts them: in the first quarter of a passage all pixels are open, in the
        last quarter of its first half all are hidden.
    sensor : Sensor
        Of the same exposure. Its dark counts are taken as they are.
    frames : int
        Of half a passage.

    Raises
    ------
    ValueError
        When counters are so full that they do not tell the light.
    """
    hiding = counts.reshape(-1, 2, frames, *counts.shape[1:])[:, 0]
    quarter = frames // 4
    factor = draw_fixed_pattern(sensor, (counts.shape[1], counts.shape[2])).efficiency_factor
    one_hz = factor[None] / (factor.mean() * sensor.exposure_s)

    def read(photons: float) -> float:
        return float(reading_moments(photons * one_hz, sensor)[0].mean())

    def photons(level: float) -> float:
        if level <= read(0.0):
            return 0.0
        most = 2 * level + 1
        while read(most) < level:
            most *= 2
            if most > _BRIGHTEST:
                raise ValueError(
                    f"an open pixel counts {level:.4g} on average, more than the model does in any "
                    "light; record it with less light"
                )
        return float(brentq(lambda each: read(each) - level, 0.0, most, xtol=1e-3))

    return BenchLight(
        photons(float(hiding[:, :quarter].mean())), photons(float(hiding[:, -quarter:].mean()))
    )
