"""Work done in several processes at once, of the kind that holds Python's lock, such as drawing.

What is to be done holds functions and arrays that cannot be sent to another process; a process that
is forked has them. Where processes are not forked, or Mitsuba runs, whose threads do not
survive it, one thing is done after the other. A process ends with the one that forked it.
"""

import multiprocessing
import os
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any, TypeVar

Result = TypeVar("Result")

_tasks: Sequence[Callable[[], Any]] = ()
"""Those of the processes that are forked next."""


def side_by_side(tasks: Sequence[Callable[[], Result]]) -> Iterator[Result]:
    """Yield what tasks return, in their order; what they return can be sent between processes."""
    global _tasks
    workers = min(os.cpu_count() or 1, len(tasks))
    if workers < 2 or sys.platform != "linux" or _mitsuba_runs():
        yield from (task() for task in tasks)
        return
    _tasks = tasks
    pool = ProcessPoolExecutor(workers, multiprocessing.get_context("fork"), _watch)
    try:
        with warnings.catch_warnings():
            # Python from 3.12 on warns of forking where there are threads; those of NumPy survive.
            warnings.filterwarnings("ignore", "This process .* is multi-threaded")
            yield from pool.map(_run, range(len(tasks)))
    finally:
        # who interrupts does not wait for what is half done
        pool.shutdown(wait=False, cancel_futures=True)
        _tasks = ()


def _mitsuba_runs() -> bool:
    mitsuba = sys.modules.get("mitsuba")
    return mitsuba is not None and mitsuba.variant() is not None


def _watch() -> None:
    """See to it that this process ends with the one that forked it, also where that is killed."""
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()  # reads the end of a pipe that the parent alone holds open
    os._exit(1)


def _run(number: int) -> Any:
    return _tasks[number]()
