"""Damage that leaves the size of a file alone is named by every verb that would use it."""

import os

import numpy as np
import pytest

from megalopta.cli import main as cli
from megalopta.dataset.store import open_sequence
from megalopta.stages.run import finished, run_stage

from ..small import content

COUNTS = "counts/grating/spadcam-starlight.zarr"
RESPONSES = "results/grating/responses/spadcam-starlight.zarr"
OF_STAGES = {
    "radiance/grating/frame_0002.exr": "render",
    "radiance/grating/scene.json": "render",
    "truth/grating/frame_0002.exr": "render",
    "training/flow/grating/frame_0002.flo": "render",
    f"{COUNTS}/counts/c/0/0/0": "sense",
    f"{COUNTS}/zarr.json": "sense",
    "training/final/grating/frame_0001.png": "sense",
    "results/grating/flow.json": "flow",
    f"{RESPONSES}/BM/c/0/0/0/0": "flow",
    f"{RESPONSES}/zarr.json": "flow",
    "results/grating/benchmark.json": "benchmark photons",
    "results/grating/benchmark.csv": "benchmark photons",
}


def scrambled(path):
    """Random bytes in the place of a file's, at the same time and of the same size."""
    seen = path.stat()
    path.write_bytes(np.random.default_rng(1).bytes(seen.st_size))
    os.utime(path, ns=(seen.st_atime_ns, seen.st_mtime_ns))
    return path


@pytest.mark.parametrize("name", OF_STAGES)
def test_the_report_names_a_damaged_file_and_what_mends_it(whole_copy, refused, name):
    path, before = scrambled(whole_copy / name), content(whole_copy)
    told = refused("report", whole_copy)
    command = f"run first: megalopta {OF_STAGES[name]} {whole_copy}"
    assert f"{path} is missing or damaged; {command}" in told
    assert content(whole_copy) == before


def test_a_stage_makes_again_what_only_has_the_right_size(whole_copy, capsys):
    before = content(whole_copy)
    path = scrambled(whole_copy / "results/grating/flow.json")
    cli.main(["flow", str(whole_copy)])
    told = capsys.readouterr().err
    assert f"flow: {path} is missing or damaged; recomputing" in told
    assert "already has it" not in told
    assert content(whole_copy) == before


def test_damage_to_what_a_stage_needs_is_named(whole_copy, tmp_path, refused):
    path = scrambled(whole_copy / "radiance/grating/frame_0001.exr")
    before = content(whole_copy)
    for words in (
        ("sense", whole_copy, "--redo"),
        ("benchmark", "sequence", whole_copy, "--out", tmp_path / "out"),
        ("check", "truth", whole_copy),
    ):
        assert f"{path} is missing or damaged" in refused(*words)
    assert content(whole_copy) == before


def test_a_hash_is_computed_once_while_nothing_changes(whole_copy, monkeypatch):
    dataset, opened = open_sequence(whole_copy), []
    finished(dataset)
    monkeypatch.setattr("hashlib.file_digest", lambda *given: opened.append(given))
    run_stage(whole_copy, dataset.configuration, "flow")
    assert opened == []
