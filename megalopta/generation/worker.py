"""A worker process: it does the jobs that come through its standard input.

The argument is the process that started it. First comes the job, pickled, then a line for each
index. The answers, pickled, go to standard output, and nothing else does.
"""

import ctypes
import os
import pickle
import signal
import sys
import threading
from queue import SimpleQueue

from megalopta.generation.attempt import Outcome, attempt

_PR_SET_PDEATHSIG = 1


def main() -> None:
    """Do jobs until the process that gives them closes the pipe, or is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this one ends it
    _end_with_parent()
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # libraries print what they like
    job, threads = pickle.load(sys.stdin.buffer)
    orders: SimpleQueue[int] = SimpleQueue()
    threading.Thread(target=_listen, args=(orders,), daemon=True).start()
    answer = Outcome(-1)  # ready
    while True:
        pickle.dump(answer, answers)
        answers.flush()
        answer = attempt(job, orders.get(), threads)


def _end_with_parent() -> None:
    """Let Linux end this process at once with the one that started it.

    Elsewhere the end of the pipe does, once the library that computes lets go of the interpreter:
    compiling a kernel takes seconds.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if sys.argv[1:] not in ([], [str(os.getppid())]):  # which ended while this one started
            os._exit(0)


def _listen(orders: "SimpleQueue[int]") -> None:
    for line in sys.stdin.buffer:
        orders.put(int(line))
    os._exit(0)  # also in the middle of a job: nobody waits for it


if __name__ == "__main__":
    main()
