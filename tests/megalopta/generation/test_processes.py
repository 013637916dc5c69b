"""`dataset make --workers` as processes: they listen nowhere, and none outlives the command."""

import os
import signal
import sys

import pytest

from ..process_group import in_a_group, listening, members, wait_for

PLAN = """
sequences: 4
scenes: [{preset: grating}]
every: {camera: {width: 24, height: 24}, trajectory: {frames: 40}, render: {samples_per_pixel: 1}}
sensors: [ideal]
light_levels: [twilight]
splits: {train: 1}
"""


@pytest.mark.slow
@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGINT, signal.SIGTERM])
def test_workers_listen_nowhere_and_end_with_the_command_without_litter(tmp_path, way):
    litter = tmp_path / "litter"
    litter.mkdir()
    (tmp_path / "plan.yaml").write_text(PLAN)
    words = [sys.executable, "-m", "megalopta", "dataset", "make", "plan.yaml", "--workers", "2"]
    with in_a_group(
        [*words, "--out", "made"],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(litter)},
        # a shell that runs tests in the background has its children ignore Ctrl-C
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as command:
        found = set()
        while not list((tmp_path / "made" / ".making").glob("*/data")):
            found |= listening(members(command.pid))
            assert command.poll() is None, command.stderr.read()
        assert len(members(command.pid)) == 4  # one looks after the resources of the others
        assert not found | listening(members(command.pid))
        os.kill(command.pid, way)
        wait_for(lambda: not members(command.pid), 5)
    assert not list(litter.iterdir())
