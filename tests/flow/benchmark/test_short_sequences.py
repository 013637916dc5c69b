"""Short sequences: what is drawn for which detector, where they start, and their memory."""

import numpy as np
import pytest

from megalopta.assets_gen.grating import sine_grating
from megalopta.flow import METHODS, MovingTemplate, SearchSettings
from megalopta.flow.benchmark.search import ShortSequences, phase_shifts

X = np.arange(251) / 251
STIMULUS = MovingTemplate(sine_grating(X[None], X[:, None], 0.9, 5, (0, 0), "rot"), 5, 60)


@pytest.mark.parametrize("name", ["BM", "EMD", "NDS"])
def test_a_detector_that_needs_few_frames_sees_the_first_of_the_others(name):
    settings = SearchSettings(frames=3)
    alone, together = (
        ShortSequences(STIMULUS, settings, 0, "grating", [METHODS[each] for each in names])
        for names in ((name,), ("BM", "EMD", "NDS"))
    )
    few = METHODS[name].noise_memory_frames + 3
    many = METHODS["EMD"].noise_memory_frames + 3
    together.counts(1e5, 2, 1, many)
    np.testing.assert_array_equal(
        alone.counts(1e5, 2, 1, few), together.counts(1e5, 2, 1, few), strict=False
    )
    np.testing.assert_array_equal(alone.clean(1, 0, few), together.clean(1, 0, few))


def test_places_of_a_grating_do_not_share_a_phase():
    for cycles in range(1, 8):
        phases = np.array(phase_shifts(251, 4)) * cycles / 251 % 1
        assert np.ptp(np.append(phases, phases + 1)) > 1
