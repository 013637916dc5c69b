"""Jobs that worker processes can import."""

import os
import signal
import time

from megalopta.core.errors import UserError


class Job:
    """Writes a file; refuses number 3; dies once at number 4, and always at number 5."""

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
        if index == 5:
            os._exit(1)
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
