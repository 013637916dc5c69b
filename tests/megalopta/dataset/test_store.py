"""What is read of a finished sequence is compared with its record."""

import os
import pickle
import shutil

import pytest

import megalopta
from megalopta.benchmark.ranking_run import run_ranking
from megalopta.core.errors import UserError
from megalopta.report.dataset_card import write_card, write_view


@pytest.fixture
def copy(single_dataset, tmp_path):
    target = tmp_path / "data"
    return shutil.copytree(single_dataset, target, symlinks=True, copy_function=os.link)


def damaged(path):
    """Change a byte in the middle, and leave the size."""
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.unlink()
    path.write_bytes(content)


READS = {
    "radiance/000000/frame_0001.exr": lambda sequence: sequence.radiance[0],
    "truth/000000/frame_0002.exr": lambda sequence: sequence.depth[1],
    "training/flow/000000/frame_0001.flo": lambda sequence: one_pair(sequence)[0],
    "training/occlusions/000000/frame_0001.png": lambda sequence: one_pair(sequence)[0],
    "counts/000000/spadcam-twilight.zarr/counts/c/0/0/0": lambda sequence: sequence.counts()[1],
    "counts/000000/spadcam-twilight.zarr/zarr.json": lambda sequence: sequence.counts(),
}


def one_pair(sequence):
    from megalopta.dataset.opened import FlowPairs

    return FlowPairs([sequence], None, 1)


@pytest.mark.parametrize("name", READS)
def test_reading_a_damaged_file_names_it(copy, name):
    sequence = megalopta.open_dataset(copy)[0]
    READS[name](sequence)
    damaged(copy / name)
    again = megalopta.open_dataset(copy)[0]
    with pytest.raises(UserError, match=f"{name} is not as it was written; .*dataset check"):
        READS[name](pickle.loads(pickle.dumps(again)))


def test_what_is_not_read_is_not_compared(copy):
    damaged(copy / "radiance/000000/frame_0002.exr")
    sequence = megalopta.open_dataset(copy)[0]
    assert sequence.radiance[0].shape == (12, 16, 2)
    (copy / "truth/000000/frame_0001.exr").unlink()
    with pytest.raises(UserError, match=r"frame_0001\.exr is missing"):
        sequence.depth[0]


def test_a_changed_record_is_named_by_all_who_read_it(copy, tmp_path):
    path = copy / "sequences/000000.json"
    text = path.read_text().replace('"split": "train"', '"split": "test"').replace("1,", "1, ")
    path.unlink()
    path.write_text(text)
    for read in (
        lambda: megalopta.open_dataset(copy)[0],
        lambda: write_view(copy, 1),
        lambda: write_card(copy),
        lambda: run_ranking(copy, tmp_path / "ranking"),
    ):
        with pytest.raises(UserError, match=r"000000\.json is not as it was written"):
            read()
