"""1000 frames/s of SPADCAM over a pseudo-terminal: gaps, share of a core, memory.

    bench_spadcam.py [SECONDS [RATE ...]]       60 1000: that rate alone, for a minute

Emulated camera and capture are processes of their own, `megalopta spadcam emulate` and `capture`.
The reference is the capture at the first rate, by default a tenth of the second. Where fewer frames
per second arrive than were asked for, this machine had no time for the emulated camera, whose share
of a core is beside the capture's. The last columns are the capture's resident memory a second after
it began, halfway and at the end; it is flat where it no longer grows in the second half.
"""

import argparse
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import NamedTuple

from megalopta.camera.recording import open_recording

RUN = "from megalopta.__main__ import main; main()"
TITLES = ("rate", "frames", "per s", "gaps", "missing", "core", "ratio", "camera")
MEMORY = ("MB start", "MB half", "MB end")


class Used(NamedTuple):
    """What a process has used so far."""

    cpu_s: float
    resident_mb: float


class Load(NamedTuple):
    """Shares of a core of capture and camera, and the capture's memory (MB) three times."""

    capture: float
    camera: float
    resident_mb: tuple[float, float, float]


def command(*words):
    line = [sys.executable, "-c", RUN, "spadcam", *map(str, words)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def used(process) -> Used:
    stat = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    status = Path(f"/proc/{process.pid}/status").read_text()
    resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return Used((int(stat[11]) + int(stat[12])) / 100, int(resident.split()[1]) / 1024)


def measure(emulating, link: Path, out: Path, rate: float, seconds: float) -> Load:
    """Capture for two seconds more than are measured."""
    words = ["--port", link, "--out", out, "--rate", rate, "--exposure", 1 / rate]
    with command("capture", *words, "--seconds", seconds + 2) as running:
        while not (out / "recording.yaml").exists():
            if running.poll() is not None:
                sys.exit(f"capture at {rate:g} frames/s ended before its first frame")
            time.sleep(0.1)
        time.sleep(1)
        camera, begin = used(emulating), used(running)
        start = time.monotonic()
        time.sleep(seconds / 2)
        half = used(running)
        time.sleep(seconds / 2)
        end, elapsed_s = used(running), time.monotonic() - start
        shares = (
            (last.cpu_s - first.cpu_s) / elapsed_s
            for first, last in ((begin, end), (camera, used(emulating)))
        )
    return Load(*shares, (begin.resident_mb, half.resident_mb, end.resident_mb))


def main() -> None:
    options = argparse.ArgumentParser()
    options.add_argument("seconds", type=float, nargs="?", default=60.0)
    options.add_argument("rates", type=float, nargs="*", default=(100.0, 1000.0))
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "cam"
        with command("emulate", "--link", link) as emulating:
            threading.Thread(target=emulating.stdout.read, daemon=True).start()
            while not link.exists():
                time.sleep(0.1)
            print(" ".join(f"{title:>8}" for title in TITLES + MEMORY))
            reference = 0.0
            for rate in given.rates:
                out = Path(folder) / f"{rate:g}"
                load = measure(emulating, link, out, rate, given.seconds)
                reference = reference or load.capture
                record = open_recording(out).settings
                per_s = record.frames / (given.seconds + 2)
                counted = f"{per_s:8.1f} {record.gaps:8} {record.missing_frames:8}"
                shares = f"{load.capture:8.3f} {load.capture / reference:8.1f} {load.camera:8.3f}"
                memory = " ".join(f"{each:8.1f}" for each in load.resident_mb)
                print(f"{rate:8g} {record.frames:8} {counted} {shares} {memory}", flush=True)
            emulating.terminate()


if __name__ == "__main__":
    main()
