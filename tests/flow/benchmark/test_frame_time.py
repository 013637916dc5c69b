"""Computing time is that of the processor, per frame, and leaves out the first run."""

import time

import numpy as np
import pytest

from megalopta.flow.detectors.base import milliseconds_per_frame
from megalopta.flow.detectors.intensity import IntensityMeasurement

BUSY_S, COMPILING_S, IDLE_S = 0.002, 0.1, 0.02


def _work(seconds):
    start = time.process_time()
    while time.process_time() - start < seconds:
        pass


class _Busy(IntensityMeasurement, frozen=True):
    def start(self, shape):
        compiled = []

        def respond(frames, scale):
            if not compiled:
                _work(COMPILING_S)
                compiled.append(True)
            _work(BUSY_S * len(frames))
            time.sleep(IDLE_S)
            return np.zeros(frames.shape)

        return respond


def test_time_per_frame_is_what_a_frame_keeps_the_processor_busy():
    # sleeping would add 5 ms, the first run 25 ms
    found = milliseconds_per_frame(_Busy(), np.ones((4, 2, 2), np.uint16))
    assert found == pytest.approx(1e3 * BUSY_S, rel=0.5)
