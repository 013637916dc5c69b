"""A worker process: it does the jobs that come through its standard input.

First comes the job, pickled, then a line for each index. The answers, pickled, go to standard
output, and nothing else does.
"""

import os
import pickle
import signal
import sys
import threading
from queue import SimpleQueue

from megalopta.engine.attempt import Outcome, attempt


def main() -> None:
    """Do jobs until the process that gives them closes the pipe, or is no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this one ends it
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


def _listen(orders: "SimpleQueue[int]") -> None:
    for line in sys.stdin.buffer:
        orders.put(int(line))
    os._exit(0)  # also in the middle of a job: nobody waits for it


if __name__ == "__main__":
    main()
