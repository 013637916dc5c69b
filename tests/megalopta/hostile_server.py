"""Runs commands, each in a forked child of one warm process, within limits of time and memory.

A request is a line of JSON with `words` and `cwd`; so is the reply: the exit code (negative: the
signal), what was said, processor time (s) and the most memory that was resident (GB).
"""

import importlib
import json
import os
import resource
import signal
import sys
import tempfile
import time

CPU_S, WALL_S, DATA_BYTES = 20, 90, 5 * 10**9
"""Where a child is killed, beyond what the tests allow, so that they can tell by how much."""
WARM = (
    "av", "cv2", "h5py", "mitsuba", "numpy", "onnxruntime", "OpenEXR", "scipy.spatial.transform", "tifffile",
    "trimesh", "zarr", "megalopta.benchmark.clips", "megalopta.benchmark.ranking_run",
    "megalopta.benchmark.scores", "megalopta.benchmark.whole_frames", "megalopta.camera.calibration",
    "megalopta.camera.comparison", "megalopta.flow", "megalopta.stages.make", "megalopta.render",
    "megalopta.report.page", "megalopta.report.view", "megalopta.sensor",
    "megalopta.stages.importing", "megalopta.stages.registry", "megalopta.camera.measurements",
    "megalopta.verification.files", "megalopta.verification.truth",
)  # fmt: skip


def child(words, cwd, streams):
    os.chdir(cwd)
    for descriptor, stream in enumerate(streams, 1):
        os.dup2(stream.fileno(), descriptor)
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S + 1))
    resource.setrlimit(resource.RLIMIT_DATA, (DATA_BYTES, DATA_BYTES))
    from megalopta.cli.main import main

    try:
        main(words)
        code = 0
    except SystemExit as stopped:
        code = stopped.code if isinstance(stopped.code, int) else int(bool(stopped.code))
    except BaseException:
        import traceback

        traceback.print_exc()
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def run(words, cwd):
    with tempfile.TemporaryFile() as printed, tempfile.TemporaryFile() as told:
        pid = os.fork()
        if not pid:
            child(words, cwd, (printed, told))
        end = time.monotonic() + WALL_S
        done = 0
        while not done:
            done, status, used = os.wait4(pid, os.WNOHANG)
            if not done:
                time.sleep(0.005)
                if time.monotonic() > end:
                    os.kill(pid, signal.SIGKILL)
        texts = {}
        for name, stream in (("printed", printed), ("told", told)):
            stream.seek(0)
            texts[name] = stream.read().decode("utf-8", "replace")
    return {
        "code": os.waitstatus_to_exitcode(status),
        "cpu_s": used.ru_utime + used.ru_stime,
        "peak_gb": used.ru_maxrss / 1e6,
        **texts,
    }


def main():
    for name in WARM:
        try:
            importlib.import_module(name)
        except ImportError as problem:
            print(name, problem, file=sys.stderr)
    from megalopta.cli.main import program

    program()
    print("ready", flush=True)
    for line in sys.stdin:
        print(json.dumps(run(**json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
