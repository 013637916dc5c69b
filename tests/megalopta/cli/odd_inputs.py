"""Odd values, texts and files, drawn from seeds, and commands that may not take long."""

import os
import re
import signal
import socket
from itertools import pairwise

from megalopta.cli import main as cli

CPU_S, WALL_S = 10, 120
"""Longest a case may compute; and wait, which depends on what else the machine does."""

ODD_VALUES = (
    None, True, -1, 0, 1e308, -1e308, float("nan"), float("inf"), 10**400, 2**63, "", "x" * 5000, "\x1b[31m",
    "☃\u202e", "..", "/dev/zero", "/dev/urandom", "0x10", "1:2:3", "yes", [], {}, [[]], [None], {"kind": "x"},
    {"uniform": [2, 1]}, {"one_of": []}, {"path": "/dev/zero"}, "[/b]", "a\0b", "\udcff", "000731",
)  # fmt: skip
NAMES = "abcdefghij"
BOMB = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 9)}]\n" for before, name in pairwise(NAMES)
)
ODD_TEXTS = (
    b"", b"\0", b"\xff\xfe\x00", b"[" * 100_000, b"{" * 5000, b"&a [*a]", b"&a x: *a", b"a: b: c",
    b"? [1, 2]\n: 3", b"!!python/object/apply:os.system [echo]", b"!!set {a}", b"!!binary aGk=",
    b"--- 1\n--- 2", b"%YAML 9.9\n---\na: 1", b"name: x\nname: y", b"&a {<<: *a}", b"\t- x",
    b"every: &a {x: *a}", b"scene: &a {kind: *a}", BOMB.encode(), f"scene:\n  kind: [{BOMB}]".encode(),
    ("scene:\n  kind:\n" + re.sub("(?m)^", "    ", BOMB)).encode(), b"k" * 10_000 + b": 1",
    ("every:\n" + re.sub("(?m)^", "  ", BOMB)).encode(), b"%PDF-1.7", b"\x1f\x8b\x08", b"PK\x03\x04" + b"\0" * 30,
    b"x\n" * 100_000, b"a: " + b"9" * 6000, b"[1, 2", b"null", b"'",
)  # fmt: skip


class TooSlowError(BaseException):
    """Not to be caught by the program."""


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


def run(words):
    """The exit code of a command; fails where it takes too long."""
    try:
        limited(lambda: cli.main(words))
    except SystemExit as stopped:
        return stopped.code or 0
    return 0


def limited(do):
    """What a function gives; fails where it takes too long."""

    def stop(*_):
        raise TooSlowError

    limits = (
        (signal.SIGPROF, signal.ITIMER_PROF, CPU_S),
        (signal.SIGALRM, signal.ITIMER_REAL, WALL_S),
    )
    for number, timer, seconds in limits:
        signal.signal(number, stop)
        signal.setitimer(timer, seconds)
    try:
        return do()
    finally:
        for _, timer, _ in limits:
            signal.setitimer(timer, 0)
