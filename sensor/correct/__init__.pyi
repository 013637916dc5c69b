from .calibration import (
    Calibration as Calibration,
    calibrate as calibrate,
    simulated_calibration as simulated_calibration,
)
from .chain import (
    Corrected as Corrected,
    correct as correct,
)
from .defects import (
    filled_in as filled_in,
    hot_pixels as hot_pixels,
)
from .response_curve import (
    ResponseCurve as ResponseCurve,
    response_curve as response_curve,
)
