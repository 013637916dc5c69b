"""What somebody who means harm puts in the place of a file or folder of a dataset.

`link`, `pipe` and `text` return functions of a dataset's folder and a folder outside of it.
"""

import os
import shutil
import struct
import zlib
from itertools import pairwise

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
