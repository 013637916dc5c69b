"""What somebody who means harm puts in the place of a file or folder of a dataset.

`link`, `pipe` and `text` return functions of a dataset's folder and a folder outside of it.
"""

import json
import os
import pickle
import shutil
import struct
import zlib
from itertools import pairwise
from pathlib import Path

BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n"
    for before, name in pairwise("abcdefghij")
)
"""YAML that unfolds to billions of values"""


def claiming(png, width, height):
    """A PNG that claims another size."""
    changed = bytearray(png)
    changed[16:24] = struct.pack(">II", width, height)
    changed[29:33] = struct.pack(">I", zlib.crc32(changed[12:29]))
    return bytes(changed)


def replaced(path, make):
    """Put something else in the place of a file or folder, if there is one."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    make(path)


def link(name, target):
    return lambda root, outside: replaced(
        root / name, lambda path: path.symlink_to(target.format(home=outside))
    )


def pipe(name):
    return lambda root, _: replaced(root / name, os.mkfifo)


def text(name, content):
    content = content if isinstance(content, bytes) else content.encode()
    return lambda root, _: replaced(root / name, lambda path: path.write_bytes(content))


class _Runs:
    """Creates a file when it is unpickled."""

    def __init__(self, canary):
        self._canary = canary

    def __reduce__(self):
        return Path.touch, (self._canary,)


def as_format_2(store, canary):
    """Rewrite a Zarr store in format 2, whose chunks are pickles that create a file."""
    for path in [store, *sorted(path for path in store.iterdir() if path.is_dir())]:
        said = json.loads((path / "zarr.json").read_text("utf-8"))
        (path / "zarr.json").unlink()
        (path / ".zattrs").write_text(json.dumps(said.get("attributes", {})))
        if said["node_type"] == "group":
            (path / ".zgroup").write_text('{"zarr_format": 2}')
            continue
        shutil.rmtree(path / "c", ignore_errors=True)
        described = {
            "zarr_format": 2,
            "shape": said["shape"],
            "chunks": said["shape"],
            "dtype": "|O",
        }
        described |= {"compressor": None, "fill_value": None, "order": "C"}
        described |= {"filters": [{"id": "vlen-utf8"}, {"id": "pickle", "protocol": 5}]}
        (path / ".zarray").write_text(json.dumps(described))
        chunk = path / ".".join("0" for _ in said["shape"])
        chunk.write_bytes(pickle.dumps(_Runs(canary)))
