"""Worker processes of a Dask scheduler on this machine, each replaced when it dies.

Dask's own nanny gives a worker up that dies while it starts; on a machine that is short of memory
that is when workers die.
"""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_LOOKED_AFTER_EVERY_S = 0.2
_START_FAILURES = 10
"""Workers that end with an error of their own before it is clear that none will ever start."""
_THREADS_ELSEWHERE = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


@contextmanager
def kept_alive(scheduler: str, count: int) -> Iterator["Crew"]:
    """Worker processes of a scheduler, and no more of them afterwards."""
    crew = Crew(scheduler, count)
    crew.start()
    try:
        yield crew
    finally:
        crew.dismiss()


class Crew(threading.Thread):
    """So many worker processes."""

    def __init__(self, scheduler: str, count: int) -> None:
        super().__init__(daemon=True)
        self._command = [
            *(sys.executable, "-m", "distributed.cli.dask_worker", scheduler),
            *("--no-nanny", "--nthreads", "1", "--memory-limit", "0"),
            *("--no-dashboard", "--death-timeout", "60"),
        ]
        self._over = threading.Event()
        self._processes = [self._begun() for _ in range(count)]
        self._failures = 0

    @property
    def is_hopeless(self) -> bool:
        """Whether workers end by themselves as soon as they start."""
        return self._failures >= _START_FAILURES

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self._processes)

    def run(self) -> None:
        """Replace who died."""
        while not self._over.wait(_LOOKED_AFTER_EVERY_S) and not self.is_hopeless:
            for place, process in enumerate(self._processes):
                ended = process.poll()
                if ended is not None:
                    self._failures += ended > 0  # below 0 it was killed
                    self._processes[place] = self._begun()

    def dismiss(self) -> None:
        """End all of them."""
        self._over.set()
        self.join()
        for process in self._processes:
            process.kill()  # whatever it writes is whole or not at all
        for process in self._processes:
            process.wait()

    def _begun(self) -> subprocess.Popen[bytes]:
        quiet = subprocess.DEVNULL
        environment = {**_THREADS_ELSEWHERE, **os.environ}
        return subprocess.Popen(
            self._command, stdin=quiet, stdout=quiet, stderr=quiet, env=environment
        )
