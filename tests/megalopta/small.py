"""Small sequences: their settings, how to make them, and what is in their folders."""

import hashlib
import json
import os
import shutil

from megalopta.dataset.store import Tree, hashes_of, open_sequence
from megalopta.stages.registry import with_dependents
from megalopta.stages.run import forget, run_stage


def small(width, height, frames, samples=1, sensors=None, levels=None):
    """Settings, as typed, of a sequence that renders quickly."""
    given = {
        "camera.width": width,
        "camera.height": height,
        "trajectory.frames": frames,
        "render.samples_per_pixel": samples,
        "sensors": sensors and f"[{sensors}]",
        "light_levels": levels and f"[{levels}]",
    }
    return {name: str(value) for name, value in given.items() if value is not None}


TINY = small(48, 40, 24) | {
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "benchmark.sizes": "[40]",
    "benchmark.flux_min": "1e4",
    "benchmark.flux_max": "1e8",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}


def made(root, settings, *stages):
    """The dataset of settings after some stages; rendered and sensed unless told otherwise."""
    for stage in stages or ("render", "sense"):
        dataset = run_stage(root, settings, stage)
    return dataset


def content(root):
    """Every file's hash but for the time it took."""
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name != "timings.json"
    }


def without(root, *stages):
    """The dataset in a folder without some stages and those that need them."""
    dataset = open_sequence(root)
    forget(dataset, with_dependents(stages))
    return Tree(root).at(dataset.configuration)


def agreeing(root):
    """Let the record of a dataset agree with what lies there; return the dataset."""
    (path,) = (root / "sequences").glob("*.json")
    record = json.loads(path.read_text("utf-8"))
    for stage in record["stages"].values():
        places = {name.partition(".zarr/")[0] for name in stage["files"]}
        found = [root / (p if (root / p).exists() else f"{p}.zarr") for p in places]
        stage["files"] = hashes_of(root, found)
    path.write_text(json.dumps(record))
    return open_sequence(root)


def copied(root, target):
    """Copy with hard links: the program replaces files, and changes none."""
    return shutil.copytree(root, target, symlinks=True, copy_function=os.link)


def counting(function, calls, interrupted_at=None):
    """The function, which notes its calls and ends with Ctrl-C at one of them."""

    def counted(*arguments, **named):
        calls.append(arguments)
        if len(calls) == interrupted_at:
            raise KeyboardInterrupt
        return function(*arguments, **named)

    return counted
