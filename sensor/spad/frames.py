"""Parallel work on frames."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor


def over_frames(task: Callable[[int], None], frames: int, in_turn: bool = False) -> None:
    """Run a task for every frame number, in threads unless in turn.

    Each task must write to its own places.
    """
    workers = min(os.cpu_count() or 1, frames)
    if in_turn or workers <= 1:
        for frame in range(frames):
            task(frame)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(task, range(frames)):
            pass
