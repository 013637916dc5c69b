"""Estimators of OpenCV's contributed modules, where these are installed.

RLOF: robust local optical flow, dense by interpolation (Senst et al. 2012, Geistert et al. 2016).
PCAFlow: sparse matches in a basis of learned flow fields (Wulff and Black 2015). DeepFlow: the
variational part of DeepFlow, coarse to fine, without its matches (Weinzaepfel et al. 2013). They
are in `opencv-contrib-python-headless`, which replaces `opencv-python-headless`, and in no default
list: an environment without them gives the same tables.
"""

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from megalopta.core.arrays import Floats
from megalopta.flow.detectors.blocks import BlockGrid
from megalopta.flow.detectors.gray_detector import DenseDetector, eight_bits
from megalopta.flow.detectors.libraries import one_thread

Algorithm = Literal["RLOF", "PCAFlow", "DeepFlow"]
_REMEDY = "pip uninstall -y opencv-python-headless; pip install opencv-contrib-python-headless"


class ContribFlow(DenseDetector, frozen=True):
    """Dense flow of a contributed estimator with OpenCV's settings, averaged over blocks."""

    algorithm: Algorithm
    """Name of the estimator"""

    def _flow(self, _: BlockGrid, pair: Floats) -> NDArray[Any]:
        import cv2

        optflow = vars(cv2)["optflow"]  # unknown to the types of OpenCV without it
        first, second = eight_bits(pair)
        start = np.zeros((*pair.shape[1:], 2), np.float32)
        with one_thread():
            if self.algorithm == "RLOF":  # which takes colors
                colors = [cv2.cvtColor(each, cv2.COLOR_GRAY2BGR) for each in (first, second)]
                return np.asarray(optflow.calcOpticalFlowDenseRLOF(*colors, start))
            create = getattr(optflow, f"createOptFlow_{self.algorithm}")
            return np.asarray(create().calc(first, second, start))


def contrib_detector(name: str) -> ContribFlow | None:
    """Return an estimator by name, upper or lower case; None for any other name.

    Raises ValueError if OpenCV comes without it.
    """
    known = {each.casefold(): each for each in get_args(Algorithm)}
    if (found := known.get(name.casefold())) is None:
        return None
    import cv2

    if not hasattr(cv2, "optflow"):
        raise ValueError(f"{found} needs OpenCV's contributed modules; run: {_REMEDY}")
    return ContribFlow(name=found, label=f"{found}, OpenCV contrib", algorithm=found)
