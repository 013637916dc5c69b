"""Computing time of a detector, one way to measure it."""

import statistics
import time

from megalopta.flow.detectors.base import Detector
from megalopta.flow.stimuli.photons import Counts

_RUNS = 3


def milliseconds_per_frame(detector: Detector, counts: Counts) -> float:
    """Return the CPU time of a new frame whose predecessors are known, the median of three runs.

    Parameters
    ----------
    detector
    counts : (T, H, W)
        Shown four times in a row; the first fills the detector's memory and compiles.
    """
    height, width = counts.shape[1:]
    respond = detector.start((height, width))
    respond(counts, 1.0)
    spent = []
    for _ in range(_RUNS):
        start = time.process_time()
        respond(counts, 1.0)
        spent.append(time.process_time() - start)
    return 1e3 * statistics.median(spent) / len(counts)
