"""The chain: linearize, subtract the dark, divide by the flat, fill in what cannot be used."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from megalopta.core.arrays import Floats, Mask
from megalopta.sensor.calibrate.defects import filled_in
from megalopta.sensor.calibrate.frame_calibration import Calibration


@dataclass(frozen=True, eq=False)
class Corrected:
    """Frames as a perfect array of the same efficiency would have detected them, on average.

    Attributes
    ----------
    detections : (T, H, W) float64
        Photons detected in an exposure, without dark counts; below 0 where noise was.
    variance : (T, H, W) float64
        Of these: noise of the reading, of the dark and of the flat frames.
    filled : (T, H, W) bool
        Where the pixel is hot, dead or full, and neighbors stand in for it; all of a frame where
        there are none.
    ambiguous : (T, H, W) bool
        Where the pixel may have seen much more light (`ResponseCurve.ambiguous_from`).
    """

    detections: Floats
    variance: Floats
    filled: Mask
    ambiguous: Mask


def correct(counts: ArrayLike, saturated: ArrayLike, calibration: Calibration) -> Corrected:
    """Correct frames of readings.

    Parameters
    ----------
    counts, saturated : (T, H, W)
        As in `Exposure`.
    calibration : Calibration
        Of the same device.

    Raises
    ------
    ValueError
        When shapes do not match.
    """
    readings, full = np.asarray(counts, np.float64), np.asarray(saturated, np.bool_)
    if readings.ndim != 3 or readings.shape[1:] != calibration.dark.shape:
        raise ValueError(
            f"counts: shape {readings.shape}; give (frames, rows, columns) of the "
            f"{calibration.dark.shape} pixels that were calibrated"
        )
    if full.shape != readings.shape:
        raise ValueError(f"saturated: shape {full.shape}; give {readings.shape}, as the counts")
    curve, gain = calibration.curve, calibration.gain
    arrivals, noise = curve.arrivals_of(readings)
    light = arrivals - calibration.dark
    detections = light / gain
    variance = (
        noise + calibration.dark_variance + detections**2 * calibration.gain_variance
    ) / gain**2
    filled = full | (readings > curve.largest) | calibration.bad
    detections, variance = filled_in(detections, variance, filled)
    return Corrected(detections, variance, filled, readings >= curve.ambiguous_from)
