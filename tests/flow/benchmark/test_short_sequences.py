"""Short sequences: what is drawn for which detector, where they start, and their memory."""

import threading

import numpy as np
import pytest

from megalopta.assets_gen.grating import sine_grating
from megalopta.flow import METHODS, MovingTemplate, SearchSettings
from megalopta.flow.benchmark.short_sequences import ReusedMemory, ShortSequences, phase_shifts

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


def test_arrays_do_not_overlap_until_they_are_released():
    memory = ReusedMemory()
    for round_number in range(3):
        arrays = [memory.empty((k, 5), kind) for k, kind in ((7, np.uint16), (3, np.uint32))]
        for number, array in enumerate(arrays):
            array[:] = 10 * round_number + number
        assert [set(array.ravel()) for array in arrays] == [
            {10 * round_number},
            {10 * round_number + 1},
        ]
        assert [array.shape for array in arrays] == [(7, 5), (3, 5)]
        memory.release()


def test_released_memory_is_given_out_again_to_its_own_thread():
    memory = ReusedMemory()
    first = memory.empty((100,), np.uint16)
    memory.release()
    assert np.shares_memory(first, memory.empty((50,), np.uint8))
    others = []
    thread = threading.Thread(target=lambda: others.append(memory.empty((50,), np.uint8)))
    memory.release()
    thread.start()
    thread.join()
    assert not np.shares_memory(first, others[0])
