"""Work on frames, several at the same time."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def over_frames(task: Callable[[int], None], frames: int, threads: int | None = None) -> None:
    """Run a task for every frame number, in threads; it must write to places of its own.

    Raises
    ------
    ValueError
        When threads are fewer than one.
    """
    if threads is not None and threads < 1:
        raise ValueError(f"threads: {threads}; give 1 or more, or none for all cores")
    workers = min(threads or os.cpu_count() or 1, frames)
    if workers <= 1:
        for frame in range(frames):
            task(frame)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(task, range(frames)):
            pass
