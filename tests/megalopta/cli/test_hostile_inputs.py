"""Files and words that no command can use, drawn from seeds: one short sentence and exit code 2.

Every case is impossible by itself, or ends in a word that is, after the file has been read: success
is a failure. Nothing is rendered, so that hundreds run with the fast tests.
"""

import os
import re
import socket

import h5py
import numpy as np
import pytest
import tifffile
import yaml
from PIL import Image

from megalopta.config.model import load
from megalopta.config.recipe import Plan
from megalopta.config.yaml_model import to_yaml
from megalopta.dataset.store import open_sequence
from megalopta.flow.formats import read_flow, write_flo, write_flo5, write_kitti_png
from megalopta.sensor import PRESETS
from megalopta.sensor.formats.reading import read_events, read_frames
from megalopta.settings.verb_settings import settings_of

from ..harm import BOMB, claiming

LONGEST = 1000
"""Most characters that are told of a mistake"""

BAD_NUMBERS = (
    "nan", "-nan", "inf", "-inf", "1e300", "-1e300", "-0.0", "-1", "1" + "0" * 400, "0x10", "1_0", "½",
    "٣", "1:2:3", "", " ", "None", "true", "1,2", "--", "☃", "\x1b[31m", "9" * 5000,
)  # fmt: skip
ODD_VALUES = (
    None, True, -1, 0, 1e308, -1e308, float("nan"), float("inf"), 10**400, 2**63, "", "x" * 5000, "\x1b[31m",
    "☃\u202e", "..", "/dev/zero", "/dev/urandom", "0x10", "1:2:3", "yes", [], {}, [[]], [None], {"kind": "x"},
    {"uniform": [2, 1]}, {"one_of": []}, {"path": "/dev/zero"}, "[/b]", "a\0b", "\udcff", "000731",
)  # fmt: skip
ODD_TEXTS = (
    b"", b"\0", b"\xff\xfe\x00", b"[" * 100_000, b"{" * 5000, b"&a [*a]", b"&a x: *a", b"a: b: c",
    b"? [1, 2]\n: 3", b"!!python/object/apply:os.system [echo]", b"!!set {a}", b"!!binary aGk=",
    b"--- 1\n--- 2", b"%YAML 9.9\n---\na: 1", b"name: x\nname: y", b"&a {<<: *a}", b"\t- x",
    b"every: &a {x: *a}", b"scene: &a {kind: *a}", BOMB.encode(), f"scene:\n  kind: [{BOMB}]".encode(),
    ("scene:\n  kind:\n" + re.sub("(?m)^", "    ", BOMB)).encode(), b"k" * 10_000 + b": 1",
    ("every:\n" + re.sub("(?m)^", "  ", BOMB)).encode(), b"%PDF-1.7", b"\x1f\x8b\x08", b"PK\x03\x04" + b"\0" * 30,
    b"x\n" * 100_000, b"a: " + b"9" * 6000, b"[1, 2", b"null", b"'",
)  # fmt: skip


def one_of(rng, values):
    return values[int(rng.integers(len(values)))]


def mutated(tree, rng):
    """Data as YAML holds it, with one node replaced, dropped or renamed."""
    if not isinstance(tree, dict | list) or not tree or rng.random() < 0.1:
        return one_of(rng, ODD_VALUES)
    keys = list(tree) if isinstance(tree, dict) else range(len(tree))
    key = keys[int(rng.integers(len(keys)))]
    changed = tree.copy()
    if rng.random() < 0.1:
        changed.pop(key)
    elif rng.random() < 0.1 and isinstance(tree, dict):
        changed[f"{key}{one_of(rng, ('☃', 'x' * 3000, chr(27), '.'))}"] = changed.pop(key)
    else:
        changed[key] = mutated(tree[key], rng)
    return changed


def damaged(content, rng):
    """The bytes of a file, damaged in one of the ways in which files are."""
    size, way = len(content), rng.integers(6)
    if way == 0:
        return content[: rng.integers(size)]
    if way == 1:
        return one_of(rng, ODD_TEXTS)
    if way == 2:
        return rng.bytes(8) + content[8:]
    if way == 3:
        return rng.bytes(size)
    if way == 4:
        return content[: size // 2]
    return content[:4] + b"\xff" * min(24, size) + content[28:]


def put_odd(path, rng, content):
    """Put what cannot be read in the place of a file: a device, a pipe, a loop, or damage."""
    way = rng.integers(12)
    if way == 0:
        os.mkfifo(path)
    elif way == 1:
        path.symlink_to(path)
    elif way == 2:
        path.symlink_to(one_of(rng, ("/dev/zero", "/dev/urandom", "/dev/full", "/nowhere", "/")))
    elif way == 3:
        with socket.socket(socket.AF_UNIX) as file:
            file.bind(os.path.relpath(path))
    elif way == 4:
        path.mkdir()
    elif way > 5:
        path.write_bytes(damaged(content, rng))
    return path


def put_yaml(path, rng, values):
    """Put a file with one value changed, or none."""
    if rng.random() < 0.6:
        path.write_text(yaml.safe_dump(mutated(values, rng)), "utf-8")
    elif rng.random() < 0.5:
        path.write_bytes(one_of(rng, ODD_TEXTS))
    else:
        put_odd(path, rng, yaml.safe_dump(values).encode())
    return str(path)


def configuration(rng, here):
    values = yaml.safe_load(to_yaml(load("grating")))
    return ["render", put_yaml(here / "my.yaml", rng, values), "--trajectory.frames", "1"]


def plan(rng, here):
    values = Plan().model_dump(mode="json")
    values |= {"every": {"scene": {"trees": {"integer": [1, 5]}}}, "lights": ["twilight"]}
    return ["dataset", "make", put_yaml(here / "plan.yaml", rng, values), "--only", "x"]


def sweep(rng, here):
    values = {
        "trial": {"size": 12, "methods": ["IM"], "search": {"phases": 1, "bits": [2]}},
        "vary": "velocity_px",
        "values": [1, 2],
        "templates": [{"kind": "grating", "cycles_per_frame": 2}],
    }
    return ["benchmark", "photons", put_yaml(here / "sweep.yaml", rng, values), "--vary", "nowhere"]


def device(rng, here):
    values = {"measured": {"dark_counts": {"path": "dark.npy"}}, "name": "mine"}
    values = {**PRESETS["spadcam"].model_dump(mode="json"), **values}
    np.save(here / "dark.npy", np.ones((8, 8)))
    if rng.random() < 0.4:
        content = (here / "dark.npy").read_bytes()
        (here / "dark.npy").unlink()
        put_odd(here / "dark.npy", rng, content)
    path = put_yaml(here / "device.yaml", rng, values)
    return ["render", "grating", f"--sensors=[{path}]", "--trajectory.frames", "1"]


def _picture(path, rng):
    Image.fromarray(np.full((8, 8, 3), 90, np.uint8)).save(path)
    content = path.read_bytes()
    path.unlink()
    if rng.random() < 0.3:
        path.write_bytes(
            claiming(content, *one_of(rng, ((60_000, 60_000), (2**31 - 1, 1), (0, 8))))
        )
        return path
    return put_odd(path, rng, content)


FLOW = np.ones((8, 8, 2), np.float32)
ODD_ARRAYS = (
    np.ones((8, 8)), np.ones((2, 8, 8)), np.ones((8, 8, 2), int), np.ones((8, 8, 2), complex), np.zeros((0, 8, 2)),
    np.array([["x"]]), np.array([None]), np.ones(()), np.full((8, 8, 2), np.nan), np.ones((9, 9, 2)),
)  # fmt: skip


def _flow(path, rng):
    """A flow file of some format that holds none."""
    if path.suffix == ".npy" and rng.random() < 0.5:
        np.save(path, one_of(rng, ODD_ARRAYS), allow_pickle=True)
        return path
    if path.suffix == ".flo5" and rng.random() < 0.4:
        os.mkfifo(path.with_name("pipe"))
        with h5py.File(path, "w") as file:
            file["flow"] = h5py.ExternalLink(str(path.with_name("pipe")), "/flow")
        return path
    if path.suffix == ".pfm":
        return put_odd(path, rng, b"PF\n8 8\n-1.0\n" + FLOW.tobytes())
    write = {".flo": write_flo, ".flo5": write_flo5, ".png": write_kitti_png, ".npy": np.save}
    write[path.suffix](path, FLOW)
    content = path.read_bytes()
    path.unlink()
    if path.suffix == ".png" and rng.random() < 0.4:
        path.write_bytes(claiming(content, *one_of(rng, ((60_000, 60_000), (2**31 - 1, 1)))))
        return path
    return put_odd(path, rng, content)


SUFFIXES = (".flo", ".flo5", ".png", ".pfm", ".npy")


def submission(rng, here):
    (here / "truth").mkdir()
    (here / "mine").mkdir()
    good, bad = one_of(rng, (("truth", "mine"), ("mine", "truth")))
    write_flo(here / good / "frame_0001.flo", FLOW)
    _flow(here / bad / f"frame_0001{one_of(rng, SUFFIXES)}", rng)
    return ["benchmark", "submit", str(here / "mine"), "--truth", str(here / "truth")]


def pair(rng, here):
    paths = [_picture(here / "a.png", rng), here / "b.png", here / "c.flo"]
    Image.fromarray(np.full((8, 8), 90, np.uint8)).save(paths[1])
    write_flo(paths[2], FLOW)
    if rng.random() < 0.3:
        paths = [paths[1], paths[1], _flow(here / f"d{one_of(rng, SUFFIXES)}", rng)]
    return ["benchmark", "pairs", *map(str, paths), "--methods", "LK", "--photons", "1"]


def recording(rng, here):
    """A recording of another camera, damaged; or a whole one, for which nothing else is given."""
    path = here / one_of(rng, ("a.npy", "a.tif", "a.spc3", "a.bin", "a"))
    if path.suffix == ".npy" and rng.random() < 0.6:
        odd = (
            *ODD_ARRAYS,
            np.full((4, 8, 8), -1),
            np.zeros((0, 8, 8), int),
            np.ones((4, 0, 8), np.uint8),
        )
        np.save(path, one_of(rng, odd), allow_pickle=True)
    elif path.suffix == ".tif":
        tifffile.imwrite(
            here / "whole.tif", np.ones((4, 8, 8), np.uint16), photometric="minisblack"
        )
        put_odd(path, rng, (here / "whole.tif").read_bytes())
    else:
        put_odd(
            path,
            rng,
            b"\x93NUMPY\x01\0v\0{'descr': '<u2', 'fortran_order': False, 'shape': (9999999, 999, 9)}",
        )
    numbers = one_of(rng, ("0:1e-3", "0:nan", "nan:1", "inf:1", "-1:1", "0:0", "1e400:1", "x", ""))
    verb = one_of(rng, (["calibrate"], ["compare", "--device", str(here / "none.yaml")]))
    return ["spadcam", verb[0], f"{path}@{numbers}", *verb[1:], "--out", str(here / "out.html")]


def option(rng, here):
    """A numeric option or setting with a number that is none, or an impossible one."""
    path = one_of(
        rng,
        [
            path
            for path, _, value in settings_of(
                "Configuration", load("grating").model_dump(mode="json")
            )
            if type(value) in (int, float)
        ],
    )
    verbs = (
        ["render", "grating", "--trajectory.frames", "1", f"--{path}"],
        ["benchmark", "pairs", "x", "--photons"], ["benchmark", "pairs", "x", "--pairs"],
        ["benchmark", "pairs", "x", "--draws"], ["dataset", "make", "x", "--only"],
        ["dataset", "make", "x", "--workers"], ["check", "files", "x", "--truth"],
        ["reproduce", "fig-4.5", "--workers"], ["benchmark", "photons", "x", "--workers"],
        ["spadcam", "calibrate", "x", "--wavelength-nm"], ["spadcam", "calibrate", "x", "--beam-area-mm2"],
        ["spadcam", "compare", "x", "--device", "y", "--margin"], ["spadcam", "compare", "x", "--device", "y", "--seed"],
    )  # fmt: skip
    words = one_of(rng, verbs)
    return [*words[:-1], f"{words[-1]}={one_of(rng, BAD_NUMBERS)}"]


FAMILIES = {
    configuration: 110, plan: 110, sweep: 60, device: 60,
    submission: 110, pair: 40, recording: 60, option: 90,
}  # fmt: skip
FAST = 8
"""Cases of each family that the gate runs"""
CASES = [
    pytest.param(
        make, seed, id=f"{make.__name__}-{seed}", marks=[pytest.mark.slow] if seed >= FAST else []
    )
    for make, number in FAMILIES.items()
    for seed in range(number)
]


@pytest.mark.parametrize(("make", "seed"), CASES)
def test_hostile_input_gets_one_short_sentence(tmp_path, monkeypatch, capsys, run, make, seed):
    monkeypatch.chdir(tmp_path)
    words = make(np.random.default_rng([seed, *make.__name__.encode()]), tmp_path)
    code = run(words)
    told = capsys.readouterr().err
    refusals = [line for line in told.splitlines() if line.startswith("megalopta: ")]
    assert code == 2, (words, told)
    assert refusals == [told.splitlines()[-1]], told
    assert refusals[0].isprintable() and len(refusals[0]) <= LONGEST


@pytest.mark.parametrize("seed", range(60))
def test_readers_of_files_raise_what_they_say(tmp_path, monkeypatch, limited, seed):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng([seed, 1])
    path = tmp_path / f"a{one_of(rng, (*SUFFIXES, '.h5', '.npz', '.tif', '.spc3', '.bin'))}"
    content = one_of(
        rng, (b"\x89HDF\r\n\x1a\n", b"PK\x03\x04", b"II*\0", b"\x93NUMPY\x01\0", b"MPD")
    )
    put_odd(path, rng, content + rng.bytes(200))
    for read in (read_flow, read_frames, read_events):
        with pytest.raises((ValueError, OSError)):
            limited(lambda read=read: read(path))


def setting(rng, root):
    """One setting of a stage with a value that may not fit."""
    paths = [
        path
        for path, _, _ in settings_of(
            "Configuration", open_sequence(root).configuration.model_dump(mode="json")
        )
    ]
    value = yaml.safe_dump(one_of(rng, ODD_VALUES[:12]), default_flow_style=True).split("\n")[0]
    verb = one_of(rng, ("render", "sense", "flow", "benchmark photons"))
    more = ["--out", str(root)] if verb == "render" else []
    return [*verb.split(), str(root), f"--{one_of(rng, paths)}={value}", *more]


def scene(rng, root):
    """Extreme numbers that each field takes, in a scene that is built and rendered."""
    kind = one_of(rng, ("grating", "plane", "motion_bench"))
    words = ["--trajectory.frames=2", "--camera.width=24", "--camera.height=20"]
    parts = ("scene", "camera.fov", "trajectory.", "light.", "render.", "shutter")
    found = settings_of(
        "Configuration", load("grating", {"scene.kind": kind}).model_dump(mode="json")
    )
    paths = [p for p, _, v in found if p.startswith(parts) and not isinstance(v, str)]
    for path in {one_of(rng, paths) for _ in range(3)} - {"trajectory.frames"}:
        words.append(
            f"--{path}={one_of(rng, ('1e-300', '1e-9', '1e9', '1e30', '-1e300', '0', '7'))}"
        )
    return ["render", "grating", f"--scene.kind={kind}", *words, "--out", str(root.parent / "out")]


def record(rng, root):
    """A damaged record, frame or store, then a command that reads it."""
    name, verb = one_of(
        rng,
        (
            ("dataset.yaml", "sense"),
            ("sequences/grating.json", "flow"),
            ("timings.json", "sense"),
            ("radiance/grating/scene.json", "check truth"),
            ("truth/grating/frame_0002.exr", "check truth"),
            ("radiance/grating/frame_0002.exr", "benchmark photons"),
            ("counts/grating/spadcam-starlight.zarr/zarr.json", "flow"),
            ("counts/grating/spadcam-starlight.zarr/counts/c/0/0/0", "report"),
        ),
    )
    content = (root / name).read_bytes()
    (root / name).unlink()
    if name.endswith(("json", "yaml")) and rng.random() < 0.6:
        values = mutated(yaml.safe_load(content), rng)
        (root / name).write_text(yaml.safe_dump(values), "utf-8")
    else:
        (root / name).write_bytes(damaged(content, rng))
    return [*verb.split(), str(root)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("make", [setting, scene, record])
def test_what_may_be_harmless_works_or_gets_one_sentence_and_loses_nothing(
    whole_copy, capsys, run, make, seed
):
    words = make(np.random.default_rng([seed, len(make.__name__)]), whole_copy)
    before = {path: path.read_bytes() for path in whole_copy.rglob("*") if path.is_file()}
    code = run(words)
    told = capsys.readouterr().err
    assert "Traceback" not in told, words
    assert code in (0, 2) or (words[0] == "check" and code == 1), words
    if code:
        books = ("grating.json", "dataset.yaml", "timings.json")
        assert not [p for p in before if p.name not in books and p.read_bytes() != before[p]], words
