"""Malformed inputs of every kind, drawn from seeds: one sentence and exit code 2, and nothing lost.

A mutation may be harmless; then the command succeeds. What a command finds before it works is all
that it prints; later problems follow the lines that tell its progress.
"""

import json
import os
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
import yaml

from megalopta.cli import main as cli
from megalopta.config.model import load
from megalopta.config.settings import settings_of
from megalopta.config.yaml_model import to_yaml
from megalopta.sensor import PRESETS
from megalopta.stages.pipeline import run_stage
from megalopta.stages.registry import STAGES

pytestmark = pytest.mark.slow

CPU_S, WALL_S = 10, 120
"""Longest a case may compute; and wait, which depends on what else the machine does."""

SHORT = {"methods": "[BM, IM]", "light_levels": "[starlight]", "sensors": "[spadcam]"}

ODD_VALUES = (
    None, True, False, -1, 0, 1, 3, 1e308, -1e308, 1e-300, float("nan"), float("inf"), 10**400, 2**63,
    "", " ", "x", "x" * 5000, "☃\u202e", "\n", "..", "/dev/null", "1e400", "0x10", "1e-3", "nan",
    [], {}, [[]], [1], [1, 2, 3], {"kind": "x"}, {"a": {"b": 1}}, [None], ["x", 1], [1e308] * 3,
)  # fmt: skip

ODD_TEXTS = (
    b"", b"\n", b"\0", b"\xff\xfe\x00", b"[" * 5000, b"{" * 5000, b"&a [*a]", b"- - - -", b"a: b: c",
    b"? [1, 2]\n: 3", b"!!python/object/apply:os.system [echo]", b"!!binary x", b"!!timestamp x",
    b"!!int x", b"!!bool 3", b"--- 1\n--- 2", b"%YAML 9.9\n---\na: 1", b"name: x\nname: y", b"\t- x",
    b"&a {<<: *a}", b"x: 2024-99-99", b"\xef\xbb\xbfname: x", b"nan", b"null", b"true", b"1e999",
    b"a: " + b"9" * 6000, b"a: &b [x, x]\nc: [" + b"*b, " * 5000 + b"]", "☃: \u202e".encode(),
)  # fmt: skip


class _TooSlowError(BaseException):
    """Not to be caught by the program."""


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


def damaged(content, rng):
    """The bytes of a file, damaged in one of the ways in which files are."""
    size = len(content)
    way = rng.integers(8)
    if way == 0:
        return content[: rng.integers(size + 1)]
    if way == 1:
        return b""
    if way == 2:
        return ODD_TEXTS[rng.integers(len(ODD_TEXTS))]
    if way == 3:
        return rng.bytes(8) + content[8:]
    if way == 4:
        return content + rng.bytes(100)
    if way == 5:
        start = int(rng.integers(size))
        return content[:start] + bytes(min(64, size - start)) + content[start + 64 :]
    flipped = bytearray(content)
    for place in rng.integers(size, size=1 if way == 6 else 20):
        flipped[place] ^= 1 << int(rng.integers(8))
    return bytes(flipped)


def put_damaged(path, rng, content=None):
    """Put something damaged, or no file at all, in the place of a file."""
    content = path.read_bytes() if content is None else content
    path.unlink(missing_ok=True)
    way = rng.integers(12)
    if way == 0:
        path.mkdir()
    elif way == 1:
        path.symlink_to(path)
    elif way == 2:
        path.symlink_to(path.with_name("nowhere"))
    elif way != 3:
        path.write_bytes(damaged(content, rng))
    return path


def mutated(tree, rng):
    """Data as JSON and YAML hold it, with one node replaced, dropped or renamed."""
    if not isinstance(tree, dict | list) or not tree or rng.random() < 0.1:
        return odd(rng)
    keys = list(tree) if isinstance(tree, dict) else range(len(tree))
    key = keys[int(rng.integers(len(keys)))]
    changed = tree.copy()
    if rng.random() < 0.1:
        changed.pop(key)
    elif rng.random() < 0.05 and isinstance(tree, dict):
        changed[f"{key}☃"] = changed.pop(key)
    else:
        changed[key] = mutated(tree[key], rng)
    return changed


def odd(rng):
    return ODD_VALUES[int(rng.integers(len(ODD_VALUES)))]


def one_of(rng, values):
    return values[int(rng.integers(len(values)))]


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
        words += [f"--{spelled}", as_word(odd(rng))]
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
    words = [f"--{one_of(rng, paths)}={as_word(odd(rng))}"]
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


def yaml_file(rng, done, folder):
    """A configuration with one value changed, or damaged as a file."""
    path = folder / one_of(rng, ("my.yaml", "my.yml", "my"))
    text = to_yaml(load("grating", {**TINY, **SHORT}))
    if rng.random() < 0.5:
        path.write_text(yaml.safe_dump(mutated(yaml.safe_load(text), rng)), "utf-8")
    else:
        put_damaged(path, rng, text.encode())
    return ["render", str(path), "--out", str(done)]


def sweep_file(rng, done, folder):
    """A sweep with one value changed."""
    sweep = {
        "trial": {"size": 12, "methods": ["IM"], "search": {"phases": 1, "bits": [2], "flux_min": 1e3}},
        "vary": "velocity_px",
        "values": [1, 2],
        "templates": [{"kind": "grating", "cycles_per_frame": 2}],
    }  # fmt: skip
    path = folder / "sweep.yaml"
    path.write_text(yaml.safe_dump(mutated(sweep, rng)), "utf-8")
    return ["benchmark", "photons", str(path), "--out", str(folder / "figures")]


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
        put_damaged(path, rng)
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
    put_damaged(rendered / kind / "grating" / f"frame_{rng.integers(1, 13):04d}.exr", rng)
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
        put_damaged(path, rng)
    return ["flow", str(done)]


def picture(rng, done, folder):
    """A damaged panorama, as the template of a sweep or around the camera."""
    height = 8 if rng.random() < 0.5 else 251
    path = folder / one_of(rng, ("sky.hdr", "sky.exr", "sky.png"))
    put_damaged(path, rng, encoded(path.suffix, height))
    if height == 8:
        tiny = [f"--{key}={value}" for key, value in {**TINY, "trajectory.frames": "2"}.items()]
        scene = ["--scene.kind=panorama", f"--scene.file={path}"]
        return ["render", "grating", *tiny, *scene, "--out", str(folder / "out")]
    sweep = {
        "trial": {"size": 12, "methods": ["IM"], "search": {"phases": 1, "frames": 1, "bits": [2]}},
        "values": [1],
        "templates": [{"kind": "panorama", "name": str(path)}],
    }
    (folder / "sweep.yaml").write_text(yaml.safe_dump(sweep), "utf-8")
    return ["benchmark", "photons", str(folder / "sweep.yaml"), "--out", str(folder / "figures")]


def encoded(suffix, height, kept={}):  # noqa: B006
    """Bytes of a picture twice as wide as high."""
    if (suffix, height) not in kept:
        import mitsuba as mi

        values = np.random.default_rng(0).random((height, 2 * height, 3), np.float32)
        bitmap, stream = mi.Bitmap(values), mi.MemoryStream()
        form = {".hdr": mi.Bitmap.FileFormat.RGBE, ".exr": mi.Bitmap.FileFormat.OpenEXR}
        if suffix == ".png":
            bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.UInt8, True)
        bitmap.write(stream, form.get(suffix, mi.Bitmap.FileFormat.PNG))
        stream.seek(0)
        kept[suffix, height] = stream.raw_buffer()
    return kept[suffix, height]


def device(rng, done, folder):
    """A device with a damaged file or map."""
    maps, path = folder / "dark.npy", folder / "device.yaml"
    values = {
        "preset": "spadcam",
        "name": "mine",
        "measured": {"dark_counts": {"path": "dark.npy"}},
    }
    np.save(maps, one_of(rng, ODD_MAPS), allow_pickle=True)
    if rng.random() < 0.4:
        put_damaged(maps, rng)
    if rng.random() < 0.4:
        values = mutated({**PRESETS["spadcam"].model_dump(mode="json"), **values}, rng)
    path.write_text(yaml.safe_dump(values), "utf-8")
    if rng.random() < 0.2:
        put_damaged(path, rng)
    return ["sense", str(done.with_name("rendered")), f"--sensors=[{path}]"]


ODD_MAPS = (
    np.ones((40, 48)),
    np.ones((50, 50)),
    np.ones(3),
    np.full((40, 48), np.nan),
    np.full((40, 48), -1.0),
    np.full((40, 48), 1e300),
    np.array([["x"] * 48] * 40),
    np.array([[None] * 48] * 40),
    np.zeros((0, 0)),
    np.ones((40, 48), complex),
)


def recording(rng, done, folder):
    """A damaged recorded path of the camera."""
    path = folder / "path.csv"
    text = "".join(f"{t},0,0,{1.5 + t / 10},0,0,0,1\n" for t in range(10))
    put_damaged(path, rng, f"t,x,y,z,qx,qy,qz,qw\n{text}".encode())
    return [
        "render",
        "demo",
        "--trajectory.kind=recorded",
        f"--trajectory.csv={path}",
        "--out",
        str(done),
    ]


FAMILIES = {
    command_line: 50,
    setting: 45,
    scene: 30,
    yaml_file: 45,
    sweep_file: 20,
    record: 30,
    frame: 20,
    counts: 25,
    picture: 20,
    device: 25,
    recording: 15,
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


def test_there_are_three_hundred_cases():
    assert len(CASES) >= 300


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


def run(words):
    """The exit code of a command; fails where it takes too long."""

    def stop(*_):
        raise _TooSlowError

    limits = (
        (signal.SIGPROF, signal.ITIMER_PROF, CPU_S),
        (signal.SIGALRM, signal.ITIMER_REAL, WALL_S),
    )
    for number, timer, seconds in limits:
        signal.signal(number, stop)
        signal.setitimer(timer, seconds)
    try:
        cli.main(words)
    except SystemExit as stopped:
        return stopped.code or 0
    finally:
        for _, timer, _ in limits:
            signal.setitimer(timer, 0)
    return 0
