"""Whole inputs of every format, the ways in which they are damaged, and the verbs that read them.

`cases` lists damaged and hostile inputs, each a folder with files and a command. All is drawn from
fixed seeds.
"""

import io
import json
import os
import re
import shutil
import socket
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
import OpenEXR
import scipy.io
import tifffile
import trimesh
import yaml
from PIL import Image

from megalopta.camera.recording import Recorder
from megalopta.config.model import load
from megalopta.config.recipe import Plan
from megalopta.flow.formats import write_flo, write_flo5, write_kitti_png
from megalopta.sensor import expose_events, preset
from megalopta.sensor.formats.events import EventOrigin, write_events_hdf5
from megalopta.sensor.formats.protocol import Identity, Settings, frame_packet

from ..scenes.meshes.files import Gltf, png
from ..scenes.meshes.test_serialized import SHAPES, file_of
from ..sensor.formats.test_cameras import COUNTS, spc3
from ..sensor.formats.test_matlab import matlab_73
from ..sensor.formats.test_time_tags import CHANNELS, TICKS, photon_hdf5, ptu_of_mode_t2, spc
from .harm import BOMB, claiming

ROWS, COLUMNS = 72, 144
RNG = np.random.default_rng(0)
CODES = RNG.integers(20, 230, (ROWS, COLUMNS, 3)).astype(np.uint8)
FLOW = np.ones((ROWS, COLUMNS, 2), np.float32)
SMALL = (
    "--camera.width=16 --camera.height=12 --trajectory.frames=2 --render.samples-per-pixel=1 "
    "--render.max-depth=2 --render.bands-nm=[[450,550],[550,650]] --render.integrator=path"
)
BEFORE = "--trajectory.position-m=[-2,-1,0.2] --trajectory.look-at-m=[0,0,0.2]"
SENSE = "sense {file} --photons=2 --frames=2 --out=o"
PAIR = "benchmark pairs {file} good.png good.flo --methods=LK --photons=1 --out=p.csv"
NO_TRUTH = "benchmark pairs {file} --no-truth --methods=LK --photons=1 --pairs=1 --out=p.csv"
PANORAMA = f"render grating {SMALL} --scene.kind=panorama --scene.file={{file}} --out=o"
TRUTH = "benchmark pairs good.png good.png {file} --methods=LK --photons=1 --out=p.csv"
SUBMIT = "benchmark submit flows --truth=good_flows --out=s.json"
AS_TRUTH = "benchmark submit good_flows --truth=flows --out=s.json"
OF_MESHES = f"grating {SMALL} {BEFORE} --scene.kind=meshes --scene.files=[{{file}}] --out=o.glb"
EXPORT, MESHES = f"scene export {OF_MESHES}", f"render {OF_MESHES}"
ANIMATED = EXPORT.replace("[{file}]", '[{"file":"{file}","animate":true}]')
VIEW = "view {file} --out=v"
CALIBRATE = "spadcam calibrate {file}@0:1e-3 good.npy@1e5:1e-3 --out=d.yaml"
TAGS = "spadcam tags {file} --out=t"
LINOSPAD = TAGS + " --linospad2=2212b --columns=64"
PATH = MESHES.replace("{file}", "good.ply").replace(
    BEFORE, "--trajectory.kind=recorded --trajectory.csv={file}"
)
SENSOR = f"render grating {SMALL} --sensors=[{{file}}] --out=o"
MATERIAL = EXPORT.replace("{file}", "good.ply") + ' --scene.materials={"good":"{file}"}'
WOODS = "scene export {file} --out=o.glb"
TABLES = "spadcam calibrate dark-counts.csv crosstalk.csv autocorrelation.csv --out=d.yaml"
DESIGN = "design {file} --out=o"

READ: dict[str, tuple[str, ...]] = {
    **dict.fromkeys(("a.png", "a.jpg", "a.ppm", "a.webp"), (SENSE, PAIR)),
    "gray.png": (SENSE,),
    **dict.fromkeys(("deep.png", "light.exr", "light.hdr"), (SENSE, PANORAMA)),
    **dict.fromkeys(("moving.gif", "moving.png", "moving.webp"), (SENSE, NO_TRUTH)),
    **dict.fromkeys(("film.mp4", "film.avi"), (SENSE, NO_TRUTH)),
    "light.npy": (SENSE + " --unit=linear",),
    **dict.fromkeys(("f.flo", "f.flo5", "f.png", "f.pfm", "f.npy"), (TRUTH, SUBMIT, AS_TRUTH)),
    "t.glb": (EXPORT, ANIMATED, MESHES),
    **dict.fromkeys(
        ("t.gltf", "t.obj", "t.ply", "t.serialized", "t.stl", "text.stl"), (EXPORT,)
    ),
    "t.xml": (EXPORT, MESHES),
    **{f"t.{name}": (EXPORT.replace("{file}", "t.gltf"),) for name in ("bin", "png")},
    "t.mtl": (EXPORT.replace("{file}", "t.obj"),),
    **{f"x.{name}": (EXPORT.replace("{file}", "t.xml"),) for name in ("spd", "ply")},
    **dict.fromkeys(("r.npy", "r.tif", "r.mat"), (VIEW, CALIBRATE)),
    "r7.mat": (CALIBRATE, VIEW + " --format=mat"),
    **dict.fromkeys(("r.raw", "raw.yaml"), ("spadcam calibrate raw.yaml --out=d.yaml",)),
    "tags.spc": (TAGS,),
    **dict.fromkeys(("r.spc3", "RAW0.bin", "r.h5"), (VIEW,)),
    **dict.fromkeys(("tags.ptu", "tags.hdf5"), (TAGS,)),
    "tags.dat": (LINOSPAD,),
    "path.csv": (PATH,),
    "curve.yaml": (SENSOR, DESIGN),
    "map.yaml": (SENSOR,),
    **{f"{name}": (SENSOR.replace("{file}", of),) for name, of in (
        ("curve.csv", "curve.yaml"), ("map.npy", "map.yaml"))},
    "reflectance.csv": (MATERIAL,),
    "woods.yaml": (WOODS,),
    "recordings.yaml": ("spadcam calibrate {file} --out=d.yaml",),
    "plan.yaml": ("dataset make {file} --out=o --only=0",),
    "sweep.yaml": ("benchmark photons {file} --out=o --workers=1",),
    "config.yaml": ("render {file} --out=o",),
    **dict.fromkeys(("dark-counts.csv", "crosstalk.csv", "autocorrelation.csv"), (TABLES,)),
}  # fmt: skip
"""Files, and the commands that read them."""

TEXTS = ".csv", ".yaml", ".obj", ".mtl", ".gltf", ".xml", ".spd", "text.stl"
UNMARKED = ".csv .yaml .obj .mtl .spd .ptu .bin .avi .dat .raw .spc .mat map.npy".split()
"""Formats of which a part may be whole, or whose reader sees no more than a part"""
CHECKED = ("a.png", "gray.png", "deep.png", "f.png", ".npz")
"""Formats with checksums, which no flipped bit passes"""


class Case(NamedTuple):
    """An input: its files are put into a folder, then the command runs there."""

    name: str
    words: list[str]
    put: Callable[[Path, Path], object]
    """Of the folder, and that of whole inputs"""
    must_tell: bool = False
    """True if what is damaged can be known"""
    goes: bool = False
    """True if a whole input, which must be read"""

    @property
    def damaged(self):
        """Name of the file that is damaged."""
        return target_of(self.name.partition("-")[0])


def film(path, codec):
    with av.open(path, "w") as container:
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, "yuv420p"
        for k in range(4):
            frame = av.VideoFrame.from_ndarray(np.roll(CODES, k, axis=1), "rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def exr(path, values, **header):
    channels = {name: np.ascontiguousarray(values[..., k]) for k, name in enumerate("RGB")}
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(path))


def gltf(**changes):
    """A triangle with a picture that turns; other fields of the header."""
    file = Gltf()
    uv = file.accessor(np.array([[0, 0], [1, 0], [0, 1]], np.float32))
    mesh = file.triangle(material=0, TEXCOORD_0=uv)
    file.paint(png(CODES[:8, :8]))
    file.header |= {"nodes": [{"children": [1]}, {"mesh": mesh}], "scenes": [{"nodes": [0]}]}
    file.animate([0, 1, 2], (1, "rotation", [[0, 0, 0, 1], [0, 1, 0, 0], [0, 0, 0, 1]]))
    file.header |= changes
    return file


def write_pictures(here):
    gray, light = CODES[..., 0], (CODES / 255).astype(np.float32)
    for name in ("a.png", "a.jpg", "a.ppm", "a.webp", "good.png"):
        Image.fromarray(CODES).save(here / name)
    Image.fromarray(gray).save(here / "gray.png")
    Image.fromarray(gray.astype(np.uint16) * 256).save(here / "deep.png")
    exr(here / "light.exr", light)
    radiance = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y %d +X %d\n" % (ROWS, COLUMNS)
    (here / "light.hdr").write_bytes(
        radiance + np.full((ROWS, COLUMNS, 4), 128, np.uint8).tobytes()
    )
    first, *others = (Image.fromarray(np.roll(CODES, k, axis=1)) for k in range(3))
    for name in ("gif", "png", "webp"):
        how = {"lossless": True} if name == "webp" else {}
        path = here / f"moving.{name}"
        first.save(path, save_all=True, append_images=others, duration=40, **how)
    for name, codec in (("film.mp4", "libx264"), ("film.avi", "mpeg4")):
        film(here / name, codec)
    np.save(here / "light.npy", light[None])
    for folder in ("flows", "good_flows"):
        (here / folder).mkdir()
    for path in (here / "f.flo", here / "good.flo", here / "good_flows/frame_0001.flo"):
        write_flo(path, FLOW)
    write_flo5(here / "f.flo5", FLOW)
    write_kitti_png(here / "f.png", FLOW)
    (here / "f.pfm").write_bytes(
        b"PF\n%d %d\n-1.0\n" % (COLUMNS, ROWS) + np.pad(FLOW, ((0, 0), (0, 0), (0, 1))).tobytes()
    )
    np.save(here / "f.npy", FLOW)


def write_meshes(here):
    file = gltf()
    (here / "t.glb").write_bytes(file.glb())
    Image.fromarray(CODES[:8, :8]).save(here / "t.png")
    header = {**file.header, "buffers": [{"byteLength": len(file.data), "uri": "t.bin"}]}
    header["images"] = [{"uri": "t.png"}]
    (here / "t.gltf").write_text(json.dumps(header))
    (here / "t.bin").write_bytes(file.data)
    (here / "t.obj").write_text(
        "mtllib t.mtl\no plate\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\nvt 0 0\nvt 1 0\nvt 0 1\n"
        "usemtl paint\nf 1/1 2/2 3/3\nf 2/2 4/1 3/3\n"
    )
    (here / "t.mtl").write_text("newmtl paint\nKd 0.5 0.4 0.3\nmap_Kd t.png\n")
    ball = trimesh.creation.icosphere(1, 0.5)
    for name in ("t.ply", "good.ply", "x.ply"):
        ball.export(here / name)
    ball.export(here / "t.stl")
    (here / "t.serialized").write_bytes(file_of(*SHAPES))
    ball.export(here / "text.stl", file_type="stl_ascii")
    (here / "x.spd").write_text("400 0.1\n500 0.3\n600 0.5\n700 0.4\n")
    (here / "t.xml").write_text(
        '<scene version="3.0.0"><bsdf type="diffuse" id="green"><spectrum name="reflectance" '
        'filename="x.spd"/></bsdf><shape type="ply"><string name="filename" value="x.ply"/>'
        '<ref id="green"/><transform name="to_world"><translate x="1" y="0.5"/></transform></shape>'
        '<shape type="sphere"><point name="center" x="0" y="1" z="0"/><float name="radius" '
        'value="0.4"/><bsdf type="diffuse"><spectrum name="reflectance" value="400:0.1, 700:0.6"/>'
        "</bsdf></shape></scene>"
    )


def write_readings(here):
    bits = RNG.integers(0, 256, (40, 16, 2)).astype(np.uint8)
    for name, mean in (("r.npy", 3), ("good.npy", 60)):
        np.save(here / name, RNG.poisson(mean, (64, 16, 16)).astype(np.uint16))
    np.save(here / "bits.npy", bits)
    counts = np.load(here / "r.npy")
    (here / "r.raw").write_bytes(counts.tobytes())
    scipy.io.savemat(here / "r.mat", {"frames": np.moveaxis(counts, 0, 2)}, do_compression=True)
    matlab_73(here / "r7.mat", frames=np.moveaxis(counts, 0, 2))
    spc(here / "tags.spc", TICKS, CHANNELS)
    tifffile.imwrite(
        here / "r.tif", RNG.poisson(3, (64, 16, 16)).astype(np.uint16), photometric="minisblack"
    )
    (here / "r.spc3").write_bytes(spc3(COUNTS))
    (here / "RAW0.bin").write_bytes(RNG.bytes(3 * 512 * 64))
    rate = RNG.uniform(0, 1500, (3, 20, 30))
    sensor = preset("ideal")
    origin = EventOrigin(shape=rate.shape, frame_period_s=0.125, exposure_s=sensor.exposure_s)
    events = expose_events(rate, sensor, seed=0, stream="s")
    write_events_hdf5(here / "r.h5", events, origin)
    photon_hdf5(here / "tags.hdf5", [("photon_data", TICKS, CHANNELS)])
    ptu_of_mode_t2(here / "tags.ptu", TICKS, CHANNELS, inputs=2, stopped_ms=1500)
    (here / "tags.dat").write_bytes(RNG.bytes(4 * 2048))
    identity = Identity(16, 16, 12, 3300, "A", "test 1")
    (here / "recording").mkdir()
    recorder = Recorder(here / "recording", preset("spadcam"), "dark", identity, Settings(), 0.0)
    for number, samples in enumerate(RNG.integers(500, 4096, (50, 16, 16)).astype(np.uint16)):
        recorder.take(number / 10, frame_packet(number, 100_000 * number, samples))
    recorder.finish(0)


def write_texts(here):
    poses = [f"{k / 50},{k / 50 - 3},0,0,0,0.7071068,0,0.7071068" for k in range(20)]
    (here / "path.csv").write_text("t,x,y,z,qx,qy,qz,qw\n" + "\n".join(poses) + "\n")
    points = [(400, 0.1), (500, 0.3), (700, 0.2)]
    curve = "".join(f"{nm},{share}\n" for nm, share in points)
    (here / "curve.csv").write_text("wavelength_nm,efficiency\n" + curve)
    (here / "reflectance.csv").write_text(curve)
    np.save(here / "map.npy", np.ones((12, 16)))
    small = load("grating").model_dump(mode="json")
    small["camera"] = {"width": 16, "height": 12}
    small["trajectory"]["frames"] = 2
    small["render"] = {"samples_per_pixel": 1, "max_depth": 2, "integrator": "path",
                       "bands_nm": [[450, 550], [550, 650]]}  # fmt: skip
    woods = {"scene": {"kind": "forest", "trees": 25, "mix": {"birch": 1}},
             **{part: small[part] for part in ("camera", "render")}, "trajectory": {"frames": 2}}  # fmt: skip
    texts = {
        "good": {"preset": "spadcam", "name": "mine"},
        "curve": {"preset": "ideal", "name": "mine", "efficiency": {"path": "curve.csv"}},
        "map": {"preset": "ideal", "name": "mine", "measured": {"dark_counts": {"path": "map.npy"}}},
        "woods": woods,
        "recordings": {"recordings": [{"path": "r.npy", "exposure_s": 1e-3},
                                      {"path": "good.npy", "exposure_s": 1e-3, "light": 1e5}]},
        "raw": {"recordings": [{"path": "r.raw", "exposure_s": 1e-3, "layout": {"rows": 16, "columns": 16, "bits": 16}},
                               {"path": "good.npy", "exposure_s": 1e-3, "light": 1e5}]},
        "plan": Plan().model_dump(mode="json") | {
            "sequences": 1, "scenes": [{"preset": "grating"}], "lights": ["twilight"],
            "every": {part: small[part] for part in ("camera", "render")} | {"trajectory": {"frames": 2}},
            "sensors": ["spadcam"], "light_levels": ["twilight"],
        },
        "sweep": {
            "trial": {"size": 30, "methods": ["IM"], "search": {"phases": 1, "bits": [2]}},
            "vary": "velocity_px", "values": [1], "templates": [{"kind": "grating", "cycles_per_frame": 2}],
        },
        "config": small,
    }  # fmt: skip
    for name, values in texts.items():
        (here / f"{name}.yaml").write_text(yaml.safe_dump(values))
    for path in (Path(__file__).parents[2] / "docs/public_arrays").glob("*-1.csv"):
        shutil.copy(path, here / path.name.replace("-1", ""))


# Damage to the bytes of any file: each a function of the content and random numbers


def part(rng, content, least=1):
    return int(rng.integers(least, max(len(content), least + 1)))


def one_of(rng, values):
    return values[int(rng.integers(len(values)))]


def cut(content, rng):
    return content[: part(rng, content)]


def empty(content, rng):
    return b""


def noise(content, rng):
    return rng.bytes(max(len(content), 64))


def other_magic(content, rng):
    return rng.bytes(8) + content[8:]


def flipped(content, rng):
    changed = bytearray(content or b"\n")
    for at in rng.integers(len(changed), size=rng.integers(1, 9)):
        changed[at] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def blocked(content, rng):
    """A block of zeros or of ones, as of a disk that failed."""
    start, size = part(rng, content, 0), part(rng, content) // 2 + 1
    block = bytes([int(rng.integers(2)) * 255]) * min(size, len(content) - start)
    return content[:start] + block + content[start + size :]


def swapped(content, rng):
    """Two parts in the wrong order."""
    a, b = sorted((part(rng, content), part(rng, content)))
    return content[:a] + content[b:] + content[a:b]


def stating(content, rng):
    """Another number in the header, such as a size."""
    at = 2 * part(rng, content[:160]) // 2
    value = one_of(rng, (0, 1, -1, 2**31 - 1, -(2**31), 10**9, 65535, 2**24))
    return content[:at] + struct.pack(one_of(rng, "<>") + "i", value) + content[at + 4 :]


NUMBERS = (
    b"nan", b"inf", b"-1", b"0", b"1e300", b"-1e300", b"1e-300", b"1e9", b"999999999", b"1" * 400, b"", b"x", b"0x10",
    b"1e7", b"-0.0", b"2147483648", b"\xff", b"\xc2\xbd",
)  # fmt: skip


def renumbered(content, rng):
    """A text with another number in it."""
    places = [*re.finditer(rb"-?\d+\.?\d*(e[-+]?\d+)?", content)] or [re.match(rb"", content)]
    place = one_of(rng, places)
    return content[: place.start()] + one_of(rng, NUMBERS) + content[place.end() :]


def repeated(content, rng):
    """A text with one of its lines a hundred thousand times."""
    lines = content.splitlines(keepends=True) or [b"x\n"]
    at = int(rng.integers(len(lines)))
    times = min(100_000, 40_000_000 // max(len(lines[at]), 1))
    return b"".join([*lines[:at], (lines[at].rstrip(b"\n") + b"\n") * times, *lines[at:]])


def odd_text(content, rng):
    return one_of(rng, ODD_TEXTS)


ODD_TEXTS = (
    b"\0", b"\xff\xfe\x00", b"[" * 100_000, b"{" * 5000, b"&a [*a]", b"&a x: *a", b"a: b: c", b"? [1, 2]\n: 3",
    b"!!python/object/apply:os.system [echo]", b"!!set {a}", b"--- 1\n--- 2", b"%YAML 9.9\n---\na: 1",
    b"name: x\nname: y", b"&a {<<: *a}", b"\t- x", BOMB.encode(), b"k" * 10_000 + b": 1", b"%PDF-1.7", b"\x1f\x8b\x08",
    b"PK\x03\x04" + b"\0" * 30, b"x\n" * 100_000, b"1,2\n" * 300_000, b"a: " + b"9" * 6000, b"null", b"'",
    b"<scene>" * 100_000, b"<!DOCTYPE a [<!ENTITY b 'c'>]><scene/>", b"\n" * 1_000_000,
)  # fmt: skip
ODD_VALUES = (
    None, True, -1, 0, 1e308, -1e308, float("nan"), float("inf"), 10**400, 2**63, "", "x" * 5000, "\x1b[31m",
    "☃\u202e", "..", "/dev/zero", "/dev/urandom", "0x10", "1:2:3", "yes", [], {}, [[]], [None], {"kind": "x"},
    {"uniform": [2, 1]}, {"one_of": []}, {"path": "/dev/zero"}, "[/b]", "a\0b", "000731",
)  # fmt: skip


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


def another_value(content, rng):
    """YAML or JSON with another value at one of its nodes; a line of another text again."""
    try:
        tree = yaml.safe_load(content)
    except (yaml.YAMLError, UnicodeDecodeError):
        return renumbered(content, rng)
    if not isinstance(tree, dict | list):
        return renumbered(content, rng)
    return yaml.safe_dump(
        mutated(tree, rng), default_flow_style=content[:1] in b"{[" or None
    ).encode()


BINARY = cut, cut, empty, flipped, flipped, blocked, noise, other_magic, stating, stating, swapped
TEXT = (
    *(cut, empty, flipped, blocked, renumbered, renumbered, repeated, odd_text, odd_text),
    *[another_value] * 3,
)
SURE = cut, empty, noise
"""Damage that is no whole file of any format"""


def plug(path, content):
    with socket.socket(socket.AF_UNIX) as file:
        file.bind(os.path.relpath(path))


def sparse(path, content):
    """The file, and zeros after it that take no space on the disk."""
    path.write_bytes(content)
    os.truncate(path, 10**12)


PLACES = {
    "fifo": lambda path, _: os.mkfifo(path),
    "loop": lambda path, _: path.symlink_to(path.name),
    "zero": lambda path, _: path.symlink_to("/dev/zero"),
    "folder": lambda path, _: path.mkdir(),
    "nothing": lambda path, _: None,
    "plug": plug,
    "sparse": sparse,
}
"""What lies in the place of a file"""


def target_of(name):
    """Place of a file in a case's folder: flow lies in a folder of its own."""
    return f"flows/frame_0001{Path(name).suffix}" if name.startswith("f.") else name


def in_folder(name, make):
    """Whole inputs linked, but for one, which `make` makes of its path and content."""

    def put(here, whole):
        for path in whole.iterdir():
            if path.is_dir():
                shutil.copytree(path, here / path.name, copy_function=os.link)
            elif path.name != name:
                os.link(path, here / path.name)
        make(here / target_of(name), (whole / name).read_bytes())

    return put


def worded(command, name):
    return [word.replace("{file}", target_of(name)) for word in command.split()]


def damaged_files():
    """Cases of every file under every verb that reads it."""
    for name, commands in READ.items():
        ways = TEXT if name.endswith(TEXTS) else BINARY
        for number, command in enumerate(commands):
            for index, way in enumerate(ways if number == 0 else ways[:: 3 + number]):
                rng = np.random.default_rng([index, number, *name.encode()])
                sure = way in SURE and not name.endswith(tuple(UNMARKED))
                sure |= way in (flipped, blocked) and name.endswith(CHECKED)
                sure |= way is empty and name != "t.mtl"

                def make(path, content, way=way, rng=rng):
                    path.write_bytes(way(content, rng))

                case = f"{name}-{way.__name__}-{number}-{index}"
                yield Case(case, worded(command, name), in_folder(name, make), sure)


def odd_places():
    """Cases of things that are no file, in turn under the verbs."""
    for turn, (name, commands) in enumerate(READ.items()):
        kind = [*PLACES][turn % len(PLACES)]
        if (name, kind) != ("t.mtl", "nothing"):
            put = in_folder(name, PLACES[kind])
            yield Case(f"{name}-is-{kind}", worded(commands[0], name), put, must_tell=True)


def whole_files():
    for name, commands in READ.items():
        for number, command in enumerate(commands):
            yield Case(
                f"{name}-whole-{number}", worded(command, name),
                in_folder(name, lambda path, content: path.write_bytes(content)),
                goes=name != "tags.dat",
            )  # fmt: skip


MOST_CPU_S, MOST_GB, LONGEST = 10, 2.5, 1000
"""Most processor time and resident memory of a command, and most characters of a refusal"""


def faults(case, done):
    """Yield what is wrong with how a command ended."""
    told, code = done["told"], done["code"]
    refusals = [line for line in told.splitlines() if line.startswith("megalopta: ")]
    if "Traceback" in told or "Traceback" in done["printed"]:
        yield "a traceback"
    if code not in ((0, 1, 2) if "check" in case.words[:2] else (0, 2)):
        yield f"exit code {code}"
    if code == 2 and (refusals != told.splitlines()[-1:] or not refusals[0].isprintable()):
        yield "no sentence at the end"
    if any(len(line) > LONGEST for line in refusals):
        yield "a long sentence"
    if done["cpu_s"] > MOST_CPU_S:
        yield f"{done['cpu_s']:.1f} s of processor time"
    if done["peak_gb"] > MOST_GB:
        yield f"{done['peak_gb']:.2f} GB"
    if case.must_tell and code == 0 and Path(case.damaged).name not in told:
        yield "silence on damage"
    if case.goes and code:
        yield "a whole input is refused"


# Files that state what they do not hold, or more than anybody reads


def deflated(rows, columns):
    """A TIFF of zeros: a few bytes for each strip."""
    file, zeros = io.BytesIO(), np.broadcast_to(np.uint8(0), (rows, columns))
    tifffile.imwrite(file, zeros, photometric="minisblack", compression="zlib")
    return file.getvalue()


def blank_png(width, height, bits=1, frames=0):
    """A PNG of zeros, which deflate to a thousandth."""

    def part(name, content):
        checksum = struct.pack(">I", zlib.crc32(name + content))
        return struct.pack(">I", len(content)) + name + content + checksum

    packer = zlib.compressobj(9)
    line = bytes(1 + (width * bits + 7) // 8)
    packed = [packer.compress(line) for _ in range(height)]
    data = b"".join([*packed, packer.flush()])
    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    animated = part(b"acTL", struct.pack(">II", frames, 0)) if frames else b""
    parts = part(b"IHDR", head), animated, part(b"IDAT", data), part(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def exr_of(channels=3, window=None):
    file = Path("stated.exr")
    values = np.zeros((4, 4), np.float32)
    names = ["R", "G", "B", *(f"c{k}" for k in range(channels - 3))]
    OpenEXR.File({"type": OpenEXR.scanlineimage, "compression": OpenEXR.RLE_COMPRESSION},
                 dict.fromkeys(names, values)).write(str(file))  # fmt: skip
    content = file.read_bytes()
    file.unlink()
    if window:
        at = content.index(b"dataWindow\0box2i\0") + 21
        content = content[:at] + struct.pack("<4i", *window) + content[at + 16 :]
    return content


def many_nodes(count, chained):
    file = gltf()
    children = [{"children": [k + 1], "mesh": 0} for k in range(count)]
    file.header["nodes"] = [*children, {"mesh": 0}] if chained else [{"mesh": 0}] * count
    file.header["scenes"] = [{"nodes": [0] if chained else [*range(count)]}]
    return file.glb()


def changed_gltf(change):
    file = gltf()
    change(file.header)
    return file.glb()


def ply_stating(element, count):
    return re.sub(
        rb"element %s \d+" % element,
        b"element %s %d" % (element, count),
        trimesh.creation.box().export(file_type="ply"),
    )


def xml(inside):
    return f'<scene version="3.0.0">{inside}</scene>'.encode()


def stacked(pages):
    file = io.BytesIO()
    with tifffile.TiffWriter(file) as writer:
        for _ in range(pages):
            writer.write(np.zeros((4, 4), np.uint16), photometric="minisblack", metadata=None)
    return file.getvalue()


def gif_of(frames, reaching=8):
    """A GIF of frames that may reach beyond it."""
    head = b"GIF89a" + struct.pack("<HHBBB", 8, 8, 0x80, 0, 0) + b"\0\0\0\xff\xff\xff"
    frame = b"\x2c" + struct.pack("<HHHHB", 0, 0, reaching, reaching, 0) + b"\x02\x02\x44\x01\x00"
    return head + frame * frames + b";"


OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
SPHERE = '<shape type="sphere"><float name="radius" value="{}"/></shape>'
MANY = ", ".join(f"{k / 1000}:0.5" for k in range(1000, 501_000))
CLAIMS: dict[tuple[str, str], Callable[[], bytes]] = {
    ("r.tif", "20000²"): lambda: deflated(20_000, 20_000),
    ("r.tif", "pages"): lambda: stacked(2000)[:-200],
    ("a.png", "1 bit"): lambda: blank_png(20_000, 10_000),
    ("a.png", "4500²"): lambda: blank_png(4500, 4500, 8),
    ("a.png", "claimed"): lambda: claiming(png(CODES), 2**31 - 1, 2**31 - 1),
    ("a.webp", "16383²"): lambda: b"RIFF\x1a\0\0\0WEBPVP8L\r\0\0\0/\xff\xff\xff\x0f\0\x07\x10\x11\x11\x88\x88\xfe\x07\0",
    ("moving.png", "frames"): lambda: blank_png(8, 8, 8, frames=2**31 - 1),
    ("moving.gif", "frames"): lambda: gif_of(100_000),
    ("moving.gif", "beyond"): lambda: gif_of(3, reaching=12_000),
    ("light.exr", "window"): lambda: exr_of(window=(0, 0, 2**30, 2**30)),
    ("light.exr", "channels"): lambda: exr_of(channels=5000),
    ("light.hdr", "stated"): lambda: b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16000 +X 32000\n" + bytes(100),
    ("a.ppm", "stated"): lambda: b"P6 30000 30000 255\n" + bytes(100),
    ("f.flo", "stated"): lambda: struct.pack("<4sii", b"PIEH", 99_999, 99_999) + bytes(100),
    ("f.pfm", "stated"): lambda: b"PF\n999999 999999\n-1.0\n" + bytes(100),
    ("t.ply", "10^30 faces"): lambda: ply_stating(b"face", 10**30),
    ("t.stl", "10^9 triangles"): lambda: bytes(80) + struct.pack("<I", 10**9) + bytes(50),
    ("t.glb", "bufferView"): lambda: changed_gltf(lambda h: h["bufferViews"][0].update(byteLength=10**12)),
    ("t.glb", "accessor"): lambda: changed_gltf(lambda h: h["accessors"][0].update(count=10**12)),
    ("t.glb", "sparse"): lambda: changed_gltf(lambda h: [h["accessors"][0].pop("bufferView"), h["accessors"][0].update(count=10**9)]),
    ("t.glb", "mode 99"): lambda: changed_gltf(lambda h: h["meshes"][0]["primitives"][0].update(mode=99)),
    ("t.glb", "chain"): lambda: many_nodes(30_000, True),
    ("t.glb", "nodes"): lambda: many_nodes(300_000, False),
    ("t.glb", "materials"): lambda: changed_gltf(lambda h: h["materials"].extend([{"name": "a"}] * 200_000)),
    ("t.glb", "far"): lambda: changed_gltf(lambda h: h["nodes"][0].update(translation=[1e300, 0, 0])),
    ("t.obj", "objects"): lambda: OBJ + b"".join(b"o a%d\nf 1 2 3\n" % k for k in range(100_000)),
    ("t.obj", "faces"): lambda: OBJ + b"f 1 2 3\n" * 10_000_000,
    ("t.obj", "nan"): lambda: OBJ + b"v nan inf 0\nf 1 2 4\n",
    ("t.xml", "radius -1"): lambda: xml(SPHERE.format(-1)),
    ("t.xml", "spectrum"): lambda: xml(f'<shape type="cube"><bsdf type="diffuse"><spectrum name="reflectance" value="{MANY}"/></bsdf></shape>'),
    ("t.xml", "shapes"): lambda: xml(SPHERE.format(1) * 100_000),
    ("t.xml", "deep"): lambda: xml("<a>" * 300_000 + "</a>" * 300_000),
    ("curve.csv", "10^6 rows"): lambda: b"".join(b"%d,0.5\n" % k for k in range(1, 1_000_001)),
    ("curve.csv", "20000 rows"): lambda: b"".join(b"%d,0.5\n" % k for k in range(1, 20_001)),
    ("path.csv", "10^6 rows"): lambda: b"".join(b"%d,0,0,1.5,0,0.7071068,0,0.7071068\n" % k for k in range(1_000_000)),
}  # fmt: skip
HARMLESS = "4500²", "20000 rows"
"""Claims that may be read: they are bounded"""


def claims():
    for (name, what), make in CLAIMS.items():
        put = in_folder(name, lambda path, content, make=make: path.write_bytes(make()))
        words = worded(READ[name][0], name)
        yield Case(f"{name}-{what}", words, put, must_tell=what not in HARMLESS)


HUGE = "1e12", "999999999", "1e300", "-1", "nan", "1" + "0" * 400
SIZES = {
    f"render grating {SMALL} --out=o": (
        "camera.width", "trajectory.frames", "trajectory.frame_rate_hz", "render.samples_per_pixel", "shutter.readout_s",
    ),
    f"render demo {SMALL} --out=o": ("scene.trees", "scene.density_per_ha"),
    "sense good.png --photons=2 --out=o": ("frames", "width", "sub_frames", "burst_hz"),
    "dataset make plan.yaml --out=o": ("only",),
    "benchmark pairs good.png good.png good.flo --methods=LK --out=p.csv": ("photons", "pairs"),
}  # fmt: skip


def nothing_else(here, whole):
    in_folder("a.png", lambda path, content: None)(here, whole)


def sizes():
    """Numbers of frames, pixels, trees and the like that no machine can hold."""
    for command, names in SIZES.items():
        for name in names:
            words = [word for word in command.split() if not word.startswith(f"--{name}=")]
            for number in HUGE if name != "photons" else HUGE[2:]:
                case = f"size-{words[1]}-{name}-{number[:9]}"
                yield Case(case, [*words, f"--{name}={number}"], nothing_else)


def damaged(path, way, rng):
    """Replace a file, which may be a hard link, by a damaged one."""
    content = path.read_bytes()
    path.unlink()
    path.write_bytes(way(content or b"\n", rng))


def way_for(path, rng):
    is_text = path.suffix in (".json", ".yaml", ".csv", ".txt")
    return one_of(rng, [way for way in (TEXT if is_text else BINARY) if way is not repeated])


ON_DATASETS = (
    "sense data", "flow data", "report data", "view data --out=v", "check files data", "check truth data",
    "benchmark photons data", "benchmark sequence data --methods LK --fluxes 1e5 --out=o", "render data --out=data", "scene export data --out=o.glb",
)  # fmt: skip
ON_MANY = "check files data", "report data", "sense data --sensors=ideal", "view data --out=v"
ON_RECORDINGS = (
    "spadcam calibrate recording recording@1e5 --out=d.yaml", "spadcam compare recording --device=good.yaml --out=c.html",
    "spadcam figures recording@1 --out=g", "view recording --out=v",
)  # fmt: skip


def damaged_datasets(whole, many):
    """Cases of every file of two datasets, under the verbs in turn."""
    turn = 0
    for root, verbs in ((whole, ON_DATASETS), (many, ON_MANY)):
        for path in sorted(path for path in root.rglob("*") if path.is_file()):
            turn += 1
            rng = np.random.default_rng([turn])
            name, way = path.relative_to(root), way_for(path, rng)

            def put(here, _, root=root, name=name, way=way, rng=rng):
                shutil.copytree(root, here / "data", symlinks=True, copy_function=os.link)
                damaged(here / "data" / name, way, rng)

            verb = verbs[turn % len(verbs)]
            yield Case(f"dataset-{name}-{way.__name__}-{turn}", verb.split(), put)


def damaged_recordings(whole):
    for turn, path in enumerate(sorted((whole / "recording").rglob("*")) * 4):
        rng = np.random.default_rng([turn, 1])
        name, way = path.relative_to(whole), way_for(path, rng)

        def put(here, inputs, name=name, way=way, rng=rng):
            nothing_else(here, inputs)
            damaged(here / name, way, rng)

        words = ON_RECORDINGS[turn % len(ON_RECORDINGS)].split()
        yield Case(f"recording-{name}-{way.__name__}-{turn}", words, put)


BAD_NUMBERS = (
    "nan", "-inf", "1e300", "-1", "1" + "0" * 400, "0x10", "½", "1:2:3", "", "None", "1,2", "--",
    "\x1b[31m",
)  # fmt: skip
NUMERIC = (
    "benchmark pairs x --photons", "benchmark pairs x --pairs", "dataset make x --only", "dataset make x --workers",
    "check files x --truth", "spadcam calibrate x --wavelength-nm", "spadcam compare x --device y --margin",
)  # fmt: skip


def options():
    """Options with numbers that are none, for files that are not there."""
    for turn, command in enumerate(NUMERIC):
        *words, last = command.split()
        for number in BAD_NUMBERS[turn % 2 :: 2]:
            case = f"option{turn}-{number[:9]}"
            yield Case(case, [*words, f"{last}={number}"], lambda here, whole: None)
