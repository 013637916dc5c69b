"""1000 frames/s of SPADCAM over a pseudo-terminal: gaps, share of a core, memory.

Emulated camera and capture are processes of their own, `megalopta spadcam emulate` and `capture`.
The reference is the capture at a tenth of the frame rate. Where fewer frames per second arrive than
were asked for, this machine had no time for the emulated camera, whose share of a core is beside
the capture's. Memory is flat where the last column,
what the capture's resident memory grew by in the second half, is small against what it is.
"""

import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from megalopta.spadcam import open_recording

SECONDS = 60
RUN = "from megalopta.__main__ import main; main()"


def command(*words):
    line = [sys.executable, "-c", RUN, "spadcam", *map(str, words)]
    return subprocess.Popen(line, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def used(process) -> tuple[float, float]:
    """CPU time (s) and resident memory (MB) of a process so far."""
    stat = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    status = Path(f"/proc/{process.pid}/status").read_text()
    resident = next(line for line in status.splitlines() if line.startswith("VmRSS"))
    return (int(stat[11]) + int(stat[12])) / 100, int(resident.split()[1]) / 1024


def measure(
    emulating, link: Path, out: Path, rate: int, seconds: float
) -> tuple[float, float, float, float]:
    """Shares of a core of both, resident memory halfway (MB), and what it grew by to the end."""
    words = ["--port", link, "--out", out, "--rate", rate, "--exposure", 1 / rate]
    with command("capture", *words, "--seconds", seconds + 2) as running:
        while not (out / "recording.yaml").exists():
            time.sleep(0.1)
        time.sleep(1)
        cpu_s, _ = used(running)
        camera_s, _ = used(emulating)
        start = time.monotonic()
        time.sleep(seconds / 2)
        _, half = used(running)
        time.sleep(seconds / 2)
        end_s, last = used(running)
        elapsed_s = time.monotonic() - start
        camera = (used(emulating)[0] - camera_s) / elapsed_s
    return (end_s - cpu_s) / elapsed_s, camera, half, last - half


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "cam"
        with command("emulate", "--link", link) as emulating:
            threading.Thread(target=emulating.stdout.read, daemon=True).start()
            while not link.exists():
                time.sleep(0.1)
            titles = ("rate", "frames", "per s", "gaps", "missing", "core", "ratio", "camera")
            titles += ("MB", "MB more")
            print(" ".join(f"{title:>8}" for title in titles))
            reference = 0.0
            for rate in (100, 1000):
                out = Path(folder) / str(rate)
                share, camera, resident, more = measure(emulating, link, out, rate, seconds)
                reference = reference or share
                record = open_recording(out).settings
                per_s = record.frames / (seconds + 2)
                counted = f"{per_s:8.1f} {record.gaps:8} {record.missing_frames:8}"
                shares = f"{share:8.3f} {share / reference:8.1f} {camera:8.3f}"
                print(f"{rate:8} {record.frames:8} {counted} {shares} {resident:8.1f} {more:8.1f}")
            emulating.terminate()


if __name__ == "__main__":
    main()
