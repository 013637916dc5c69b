"""Processes of a command that runs in a group of its own, found by the system's table."""

import contextlib
import os
import signal
import subprocess
import time

import psutil


@contextlib.contextmanager
def in_a_group(command, **more):
    """Start a command as the leader of a new group; at the end nothing of it is left."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    process = subprocess.Popen(list(map(str, command)), start_new_session=True, **{**quiet, **more})
    try:
        with process:
            yield process
            process.kill()
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)


def members(leader):
    """Living processes of the group of a leader, which may be gone itself."""
    found = []
    for process in psutil.process_iter():
        with contextlib.suppress(psutil.Error, ProcessLookupError):
            if os.getpgid(process.pid) == leader and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


def wait_for(condition, seconds=60):
    """Wait until a condition holds, and return what it gave."""
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)
    return found


def listening(processes):
    """Addresses at which processes listen."""
    found = set()
    for process in processes:
        with contextlib.suppress(psutil.Error):
            found |= {
                each.laddr.ip
                for each in process.net_connections("inet")
                if each.status == psutil.CONN_LISTEN or each.type == 2  # UDP
            }
    return found
