"""Photon counts to motion: detectors, error metrics and the photon benchmark, on plain arrays.

Conventions, the same in every file of this folder:

- A sequence is an array (T, H, W): frame, row, column. Row 0 is the top of the image, column 0 its
  left edge.
- A velocity or a flow is an array (..., 2): first x, positive to the right (growing column), then
  y, positive downward (growing row), in pixels of the very frames that were handed in, per frame.
  The scene of an image whose content moves from column 10 to column 13 has velocity (+3, 0).
- Flow t leads from frame t to frame t + 1, so T frames have T − 1 flows.
- NaN is a value that is not defined: the flow of the sky, the velocity of a block without texture,
  a correlation detector at the edge of the image. It is never a stand-in for zero.
- A directional correlation detector answers positively to motion toward +x.
- A flux is the mean number of photons per frame, summed over all pixels, dark counts not included.
"""

from megalopta.flow.benchmark import photon_benchmark
from megalopta.flow.benchmark_result import BenchmarkResult
from megalopta.flow.benchmark_settings import BenchmarkSettings, SearchSettings
from megalopta.flow.color_wheel import flow_to_rgb, wheel_legend
from megalopta.flow.detection import d_prime, motion_evidence, rightward_evidence, roc
from megalopta.flow.detector import Detector
from megalopta.flow.error import ErrorSums, error_sums
from megalopta.flow.error_curve import ErrorCurve
from megalopta.flow.flo import read_flo, write_flo
from megalopta.flow.methods import METHODS, THESIS_METHODS, method
from megalopta.flow.photon_search import photon_search
from megalopta.flow.photons import draw_counts
from megalopta.flow.resize import resize
from megalopta.flow.stimulus import MovingTemplate
from megalopta.flow.threshold import Threshold, threshold
from megalopta.flow.translation_bound import least_covariance, translation_information
from megalopta.flow.triangular_pooling import triangular_pool
from megalopta.flow.truth_error import TruthError, block_flow, block_share, truth_error
from megalopta.flow.truth_splits import truth_splits
from megalopta.flow.wide_field import WideField, fit_wide_field

__all__ = [
    "METHODS",
    "THESIS_METHODS",
    "BenchmarkResult",
    "BenchmarkSettings",
    "Detector",
    "ErrorCurve",
    "ErrorSums",
    "MovingTemplate",
    "SearchSettings",
    "Threshold",
    "TruthError",
    "WideField",
    "block_flow",
    "block_share",
    "d_prime",
    "draw_counts",
    "error_sums",
    "fit_wide_field",
    "flow_to_rgb",
    "least_covariance",
    "method",
    "motion_evidence",
    "photon_benchmark",
    "photon_search",
    "read_flo",
    "resize",
    "rightward_evidence",
    "roc",
    "threshold",
    "translation_information",
    "triangular_pool",
    "truth_error",
    "truth_splits",
    "wheel_legend",
    "write_flo",
]
