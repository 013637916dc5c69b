"""Malformed words, settings and datasets, drawn from seeds: one sentence and exit code 2, and nothing lost.

A mutation may be harmless; then the command succeeds. What a command finds before it works is all
that it prints; later problems follow the lines that tell its progress.
"""

import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from megalopta.config.model import load
from megalopta.config.settings import settings_of
from megalopta.stages.pipeline import run_stage
from megalopta.stages.registry import STAGES

from .odd_inputs import ODD_VALUES, mutated, one_of, put_odd, run

pytestmark = pytest.mark.slow

SHORT = {"methods": "[BM, IM]", "light_levels": "[starlight]", "sensors": "[spadcam]"}


@pytest.fixture(scope="session")
def datasets(tmp_path_factory):
    """A dataset that is rendered, and the same one with every stage done."""
    root = tmp_path_factory.mktemp("malformed")
    settings = load("grating", {**TINY, **SHORT})
    run_stage(root / "rendered", settings, "render")
    shutil.copytree(root / "rendered", root / "done")
    for stage in ("sense", "flow", "benchmark"):
        run_stage(root / "done", settings, stage)
    return root


TINY = {
    "camera.width": "48",
    "camera.height": "40",
    "trajectory.frames": "12",
    "render.samples_per_pixel": "1",
    "render.bands_nm": "[[450, 550], [550, 650]]",
    "benchmark.sizes": "[40]",
    "benchmark.flux_min": "1e4",
    "benchmark.flux_max": "1e8",
    "benchmark.fluxes_per_decade": "1",
    "benchmark.repeats": "2",
}


def spoil(path, rng):
    """Put something odd in the place of a file."""
    content = path.read_bytes()
    path.unlink()
    put_odd(path, rng, content)


def command_line(rng, done, folder):
    """Words in any order: verbs, options, settings, and values that fit none of them."""
    paths = [path for path, _, _ in settings_of(load("grating"))]
    words = [
        one_of(
            rng, ("render", "sense", "flow", "benchmark", "report", "check", "sweep", "frob", "")
        )
    ]
    for _ in range(rng.integers(4)):
        path = one_of(rng, paths)
        spelled = path if rng.random() < 0.7 else path[: rng.integers(len(path) + 1)]
        words += [f"--{spelled}", as_word(one_of(rng, ODD_VALUES))]
    extra = (
        str(done),
        str(done),
        "nowhere",
        "",
        "--out",
        "--cache",
        "--workers",
        "0",
        "-x",
        "--",
        "truth",
    )
    words += [one_of(rng, extra) for _ in range(rng.integers(1, 4))]
    return [*words, *(["--out", str(done)] if words[0] == "render" else [])]


def setting(rng, done, folder):
    """One setting with a value that may not fit."""
    stage = one_of(rng, ("render", "sense", "flow", "benchmark"))
    settings = load("grating", {**TINY, **SHORT})
    paths = [
        path for path, _, _ in settings_of(settings) if rng.random() < 0.5 or path[:7] == "sensors"
    ]
    words = [f"--{one_of(rng, paths)}={as_word(one_of(rng, ODD_VALUES))}"]
    dataset = done.with_name("rendered") if stage in ("sense", "benchmark") else done
    verb = STAGES[stage].command.split()
    return [*verb, str(dataset), *words, *(["--out", str(done)] if stage == "render" else [])]


def scene(rng, done, folder):
    """Extreme numbers that each field takes, in a scene that is built and rendered."""
    kind = one_of(rng, ("grating", "plane", "motion_bench"))
    two = {**TINY, "trajectory.frames": "2", "scene.kind": kind}
    words = [f"--{path}={value}" for path, value in two.items()]
    settings = load("grating", two)
    rendered = ("scene", "camera", "trajectory", "light", "render", "shutter")
    paths = [
        path
        for path, _, value in settings_of(settings)
        if path.startswith(rendered) and path not in two and not isinstance(value, str)
    ]
    for path in {one_of(rng, paths) for _ in range(3)}:
        words += [
            f"--{path}={one_of(rng, ('1e-300', '1e-9', '1e9', '1e30', '1e300', '-1e300', '0', '1', '7'))}"
        ]
    return ["render", "grating", *words, "--out", str(folder / "out")]


def as_word(value):
    return (
        yaml.safe_dump(value, default_flow_style=True, width=10**6)
        .strip()
        .removesuffix("...")
        .strip()
    )


def record(rng, done, folder):
    """A damaged record of a dataset, then a command that reads it."""
    name, verb = one_of(rng, RECORDS)
    path = next(done.glob(name))
    if rng.random() < 0.6:
        lines = (
            path.read_text("utf-8").splitlines()
            if path.suffix == ".jsonl"
            else [path.read_text("utf-8")]
        )
        values = [mutated(yaml.safe_load(line), rng) for line in lines]
        path.unlink()
        write = yaml.safe_dump if path.suffix == ".yaml" else json.dumps
        path.write_text("\n".join(write(value) for value in values), "utf-8")
    else:
        spoil(path, rng)
    return [*verb.split(), str(done)]


RECORDS = (
    ("dataset.yaml", "sense"),
    ("dataset.yaml", "report"),
    ("sequences/grating.json", "flow"),
    ("timings.json", "sense"),
    ("radiance/*/scene.json", "check truth"),
)


def frame(rng, done, folder):
    """A damaged EXR of radiance or truth, then a command that reads all of them."""
    rendered = done.with_name("rendered")
    kind, verb = one_of(
        rng, (("radiance", "sense"), ("truth", "check truth"), ("radiance", "benchmark photons"))
    )
    spoil(rendered / kind / "grating" / f"frame_{rng.integers(1, 13):04d}.exr", rng)
    return [*verb.split(), str(rendered)]


def counts(rng, done, folder):
    """A damaged store of counts, then the detectors."""
    shutil.rmtree(done / "results")
    files = sorted(path for path in done.glob("counts/**/*") if path.is_file())
    path = one_of(rng, files)
    if path.name == "zarr.json" and rng.random() < 0.5:
        values = mutated(json.loads(path.read_text("utf-8")), rng)
        path.unlink()
        path.write_text(json.dumps(values), "utf-8")
    else:
        spoil(path, rng)
    return ["flow", str(done)]


FAMILIES = {
    command_line: 50,
    setting: 45,
    scene: 30,
    record: 30,
    frame: 20,
    counts: 25,
}
FAST = 4
"""Cases of each family that the gate runs"""
CASES = [
    pytest.param(
        make, seed, id=f"{make.__name__}-{seed}", marks=[pytest.mark.slow] if seed >= FAST else []
    )
    for make, number in FAMILIES.items()
    for seed in range(number)
]


@pytest.mark.parametrize(("make", "seed"), CASES)
def test_malformed_input_gets_one_sentence_and_loses_nothing(
    datasets, tmp_path, monkeypatch, capsys, make, seed
):
    for name in ("rendered", "done"):
        shutil.copytree(datasets / name, tmp_path / name, copy_function=os.link)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    rng = np.random.default_rng([seed, len(make.__name__)])
    words = make(rng, tmp_path / "done", tmp_path / "here")
    before = contents(tmp_path)
    code = run(words)
    told = capsys.readouterr().err
    assert "Traceback" not in told, words
    assert code in (0, 2) or (words[0] == "check" and code == 1), words
    refusals = [line for line in told.splitlines() if line.startswith("megalopta: ")]
    assert refusals == ([told.splitlines()[-1]] if code == 2 else []), (words, told)
    after = contents(tmp_path)
    lost = [path for path in before if after.get(path) != before[path] and path.suffix != ".json"]
    assert not [path for path in lost if path.name not in BOOKS], words


BOOKS = ("grating.json", "dataset.yaml", "report.html")
"""Written anew by a stage that succeeds."""


def contents(root):
    """Content of all files below a folder, but for those that a case makes itself."""
    return {
        path: path.read_bytes()
        for path in root.rglob("*")
        if path.is_file() and Path("here") not in path.parents
    }
