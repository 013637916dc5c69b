"""OpenCV, imported when it is first needed and kept to one thread while it works.

Its parallel loops cut a frame by the number of threads, and some estimators pass results on within
such a part: with one thread the numbers are the same on every machine. Sequences are spread over
processes anyway.
"""

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def one_thread() -> Iterator[None]:
    """OpenCV works in the calling thread inside the block, as it did before after it."""
    import cv2

    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
