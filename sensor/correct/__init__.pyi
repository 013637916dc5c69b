from .calibration import Calibration, calibrate, simulated_calibration
from .chain import Corrected, correct
from .defects import filled_in, hot_pixels
from .response_curve import ResponseCurve, response_curve

__all__ = [
    "Calibration",
    "Corrected",
    "ResponseCurve",
    "calibrate",
    "correct",
    "filled_in",
    "hot_pixels",
    "response_curve",
    "simulated_calibration",
]
