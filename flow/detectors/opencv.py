"""OpenCV, imported when it is first needed and kept to one thread while it works.

Its parallel loops cut a frame by the number of threads, and some estimators pass results on within
such a part: with one thread the numbers are the same on every machine. Sequences are spread over
processes anyway. The number of threads is one setting of the whole process.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock


class _Users:
    """Who counts on one thread, and the number to go back to."""

    lock = Lock()
    count = 0
    threads_before = 1


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV keeps to the calling thread until the last block of all callers is left."""
    import cv2

    with _Users.lock:
        if _Users.count == 0:
            _Users.threads_before = cv2.getNumThreads()
            cv2.setNumThreads(1)
        _Users.count += 1
    try:
        yield
    finally:
        with _Users.lock:
            _Users.count -= 1
            if _Users.count == 0:
                cv2.setNumThreads(_Users.threads_before)
