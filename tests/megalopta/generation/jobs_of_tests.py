"""Jobs that worker processes can import."""

import os
import signal
import time

from megalopta.core.errors import UserError
from megalopta.core.progress import progress, silent, step


class Job:
    """Writes a file; refuses number 3; dies once at number 4, so that another must do it."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, index):
        print("whatever libraries print")
        os.write(1, b"or write")
        if index == 3:
            raise UserError("three is too many")
        begun = self.folder / f"begun-{index}"
        if index == 4 and not begun.exists():
            begun.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        (self.folder / f"{index}").touch()


class Slow:
    """Says that it has begun, and takes a minute."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, index):
        (self.folder / f"begun-{index}").touch()
        time.sleep(60)


class EndsOnce(Slow):
    """Slow but for number 0."""

    def __call__(self, index):
        if index > 0:
            super().__call__(index)


def half(index):
    """Say for two seconds that half of it is done."""
    with silent(), step("baking"), progress("Light", 2, "part") as advance:
        advance()
        time.sleep(2)


def die(index):
    """Take the worker along."""
    os._exit(1)


class NeverArrives:
    """Ends the process that unpickles it."""

    def __reduce__(self):
        return os._exit, (1,)
