import threading

import numpy as np

from megalopta.flow.benchmark.reused_memory import ReusedMemory


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
