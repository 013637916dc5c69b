"""The firmware's protocol, compiled for the host, against Python's."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from megalopta.sensor.formats import protocol

HERE = Path(__file__).parent
FIRMWARE = HERE.parents[2] / "sensor/formats/firmware"
COMPILER = shutil.which("g++") or shutil.which("clang++")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C++ compiler")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    binary = tmp_path_factory.mktemp("firmware") / "host"
    sources = [HERE / "host.cpp", FIRMWARE / "protocol.cpp"]
    strict = "-std=c++14 -Wall -Wextra -Wpedantic -Werror -O1 -fsanitize=address,undefined".split()
    subprocess.run([COMPILER, *strict, "-I", FIRMWARE, *sources, "-o", binary], check=True)

    def call(mode, data):
        done = subprocess.run([binary, mode], input=data, capture_output=True, check=True)
        return done.stdout, int(done.stderr)

    return call


def packets(count, seed=0):
    """Packets of all kinds; some payloads are full of zeros, some have none, for COBS's sake."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        kind = protocol.Kind(rng.choice(list(protocol.Kind)))
        values = rng.integers(0, [1, 2, 256][rng.integers(3)], protocol.PAYLOAD_BYTES[kind])
        flipped = values.astype(np.uint8) ^ np.uint8(rng.choice([0, 255]))
        sequence, time = int(rng.integers(2**32)), int(rng.integers(2**63))
        yield protocol.Packet(kind, sequence, time, flipped.tobytes())


def test_it_reads_what_python_writes(run):
    sent = list(packets(500))
    text, damaged = run("decode", b"".join(map(protocol.encode, sent)))
    lines = [(f"{p.kind:d} {p.sequence} {p.device_us} " + p.payload.hex()).strip() for p in sent]
    assert [line.strip() for line in text.decode().splitlines()] == lines and damaged == 0


def test_it_writes_what_python_writes(run):
    line = b"".join(map(protocol.encode, packets(500, seed=1)))
    assert run("echo", line) == (line, 0)


def test_it_refuses_the_same_damage(run):
    line = bytearray(b"".join(map(protocol.encode, packets(2000, seed=2))))
    rng = np.random.default_rng(3)
    for at in rng.integers(0, len(line), 600):
        line[at] ^= 1 << rng.integers(8)
    parser = protocol.Parser()
    found = list(parser.feed(bytes(line)))
    text, damaged = run("decode", bytes(line))
    assert len(text.splitlines()) == len(found) < 2000
    assert damaged == parser.damaged


COMMANDS = [
    protocol.command(protocol.Kind.IDENTIFY),
    protocol.command(protocol.Kind.SET_EXPOSURE, 100_000),
    protocol.command(protocol.Kind.SET_EXPOSURE, 100_001),
    protocol.command(protocol.Kind.SET_EXPOSURE, 0),
    protocol.command(protocol.Kind.SET_FRAME_RATE, 1_000_000),
    protocol.command(protocol.Kind.SET_EXPOSURE, 1000),
    protocol.command(protocol.Kind.SET_FRAME_RATE, 1_000_000),
    protocol.command(protocol.Kind.SET_FRAME_RATE, 0),
    protocol.command(protocol.Kind.SET_STEP_BIAS, 4095),
    protocol.command(protocol.Kind.SET_STEP_BIAS, 4096),
    protocol.command(protocol.Kind.SET_ROW_WINDOW, 3, 4),
    protocol.command(protocol.Kind.SET_ROW_WINDOW, 4, 4),
    protocol.command(protocol.Kind.SET_ROW_WINDOW, 0, 17),
]


def test_it_answers_as_settings_of_python_do(run):
    commands = [
        protocol.Packet(*each[:1], number, 0, each[1]) for number, each in enumerate(COMMANDS)
    ]
    replies = list(
        protocol.Parser().feed(run("answer", b"".join(map(protocol.encode, commands)))[0])
    )
    assert [reply.sequence for reply in replies] == list(range(len(COMMANDS)))
    identity = protocol.Identity(16, 16, 12, 3300, "0123456789ABCDEF", "spadcam 1.0")
    assert protocol.Identity.of(replies[0].payload) == identity
    assert replies[0].payload == identity.payload()
    settings = protocol.Settings()
    for sent, reply in zip(commands[1:], replies[1:], strict=True):
        settings = settings.after(sent)
        assert protocol.Settings.of(reply.payload) == settings
    assert settings.refused and settings.exposure_us == 1000
    assert (settings.first_row, settings.end_row) == (3, 4)
