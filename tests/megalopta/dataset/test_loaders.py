"""Loaders of others read a small dataset as it is; those that need PyTorch where it is installed.

`pip install megalopta[loaders]` brings them.
"""

import json
import shutil
from itertools import pairwise

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest

from megalopta.dataset.index import write_index
from megalopta.dataset.store import Tree
from megalopta.flow.formats import read_flo

PAIRS = 2  # of each sequence of three frames


@pytest.fixture(scope="module")
def truth(small_dataset):
    """Flow of the first pair of each sequence."""
    return [read_flo(path) for path in sorted(small_dataset.glob("training/flow/*/frame_0001.flo"))]


def equal_where_known(found, expected):
    known = np.isfinite(expected)
    assert known.mean() > 0.9
    np.testing.assert_array_equal(np.asarray(found)[known], expected[known])


def raft_lists(root, split="training", dstype="clean"):
    """Pairs of images and flow files, found as RAFT finds them."""
    images, flows = [], []
    for scene in sorted(path.name for path in (root / split / dstype).iterdir()):
        images += pairwise(sorted((root / split / dstype / scene).glob("*.png")))
        flows += sorted((root / split / "flow" / scene).glob("*.flo"))
    return images, flows


@pytest.mark.parametrize("dstype", ["clean", "final"])
def test_listing_as_raft_does_pairs_images_with_flow(small_dataset, dstype):
    images, flows = raft_lists(small_dataset, dstype=dstype)
    assert len(images) == len(flows) == 3 * PAIRS
    for (first, second), flow in zip(images, flows, strict=True):
        shape = cv2.imread(str(first)).shape
        assert shape == cv2.imread(str(second)).shape == (*read_flo(flow).shape[:2], 3)
        assert (first.parent.name, first.stem) == (flow.parent.name, flow.stem)


def test_every_split_is_a_tree_of_its_own(small_dataset):
    for split in ("train", "sample"):
        names = (small_dataset / f"splits/{split}.txt").read_text().split()
        _, flows = raft_lists(small_dataset / "splits" / split / "Sintel")
        assert len(flows) == PAIRS * len(names)
    assert names == ["000000", "000001"]


def kitti_lists(root):
    """First and second pictures and flow files, found as KITTI's loaders find them."""
    patterns = ("image_2/*_10.png", "image_2/*_11.png", "flow_occ/*_10.png")
    return [sorted((root / "training").glob(pattern)) for pattern in patterns]


@pytest.mark.parametrize("is_linked", [True, False], ids=["moved", "copied without links"])
def test_listing_as_kitti_does_pairs_pictures_with_flow(small_dataset, tmp_path, is_linked):
    root = shutil.copytree(small_dataset, tmp_path / "elsewhere/moved", symlinks=is_linked)
    names = (root / "splits/sample.txt").read_text().split()
    lists = kitti_lists(root / "splits/sample/KittiFlow")
    pairs = [(name, index) for name in names for index in range(PAIRS)]
    for (name, index), *files in zip(pairs, *lists, strict=True):
        for path, frame in zip(files[:2], (index + 1, index + 2), strict=True):
            final = root / f"training/final/{name}/frame_{frame:04d}.png"
            assert path.read_bytes() == final.read_bytes()
            assert path.resolve().is_relative_to(root)
        blue, green, red = np.moveaxis(cv2.imread(str(files[2]), cv2.IMREAD_UNCHANGED), -1, 0)
        decoded = np.stack([red, green], axis=-1).astype(float) / 64 - 512  # px
        exact = read_flo(root / f"training/flow/{name}/frame_{index + 1:04d}.flo")
        np.testing.assert_array_equal(blue, np.isfinite(exact).all(axis=-1))
        assert np.abs(decoded - exact)[blue == 1].max() <= 1 / 128 + 1e-6
    write_index(Tree(root), Tree(root).plan)
    assert len(kitti_lists(root / "splits/sample/KittiFlow")[0]) == len(pairs)


@pytest.mark.filterwarnings("ignore")
def test_kitti_loaders_of_torchvision_and_ptlflow_read_it(small_dataset, truth):
    of_torchvision = pytest.importorskip("torchvision.datasets")
    of_ptlflow = pytest.importorskip("ptlflow.data.datasets")
    *pictures, flow, valid = of_torchvision.KittiFlow(small_dataset / "splits/sample")[0]
    assert [picture.size for picture in pictures] == [(32, 24)] * 2
    known = np.asarray(valid, bool)
    assert known.mean() > 0.9
    in_steps = np.rint(truth[0] * 64) / 64
    np.testing.assert_array_equal(np.moveaxis(flow, 0, -1)[known], in_steps[known])
    folder = str(small_dataset / "splits/sample/KittiFlow")
    pairs = of_ptlflow.KittiDataset(root_dir_2015=folder, split="trainval")
    assert len(pairs) == 2 * PAIRS
    found = np.asarray(pairs[0]["flows"][0]).squeeze()
    np.testing.assert_array_equal(found[known], in_steps[known])


@pytest.mark.filterwarnings("ignore")
def test_torchvision_reads_it(small_dataset, truth):
    datasets = pytest.importorskip("torchvision.datasets")
    found = datasets.Sintel(root=small_dataset / "splits/sample", pass_name="both")
    assert len(found) == 2 * 2 * PAIRS
    first, _, flow = found[0]
    assert first.size == (32, 24)
    equal_where_known(np.moveaxis(flow, 0, -1), truth[0])


@pytest.mark.filterwarnings("ignore")
def test_ptlflow_reads_it(small_dataset, truth):
    datasets = pytest.importorskip("ptlflow.data.datasets")
    found = datasets.SintelDataset(str(small_dataset), split="trainval", pass_names="final")
    assert len(found) == 3 * PAIRS
    pair = found[0]
    flow, valid = (np.asarray(pair[name][0]).squeeze() for name in ("flows", "valids"))
    assert valid.mean() > 0.9
    np.testing.assert_array_equal(flow[valid > 0.5], truth[0][valid > 0.5])


@pytest.mark.filterwarnings("ignore")
def test_hugging_face_reads_tables_and_pictures(small_dataset, tmp_path):
    datasets = pytest.importorskip("datasets")
    index = str(small_dataset / "index/frames.parquet")
    rows = datasets.load_dataset(
        "parquet", data_files=index, split="train", cache_dir=str(tmp_path)
    )
    assert [row["frame"] for row in rows] == [1, 2, 3] * 3
    assert (small_dataset / rows[0]["flow"]).is_file()
    clean = str(small_dataset / "training/clean")
    pictures = datasets.load_dataset(
        "imagefolder", data_dir=clean, split="train", cache_dir=str(tmp_path)
    )
    assert [pictures[place]["image"].size for place in (0, 8)] == [(32, 24)] * 2


@pytest.mark.filterwarnings("ignore:.*:DeprecationWarning")  # of the libraries it rests on
def test_mlcroissant_accepts_it_and_reads_the_tables(small_dataset):
    mlcroissant = pytest.importorskip("mlcroissant")
    described = mlcroissant.Dataset(jsonld=str(small_dataset / "croissant.json"))
    assert not described.metadata.ctx.issues.errors
    rows = list(described.records("sequences"))
    assert [row["sequences/sequence"] for row in rows] == [b"000000", b"000001", b"000002"]


def test_every_path_of_the_index_is_there(small_dataset):
    frames = pq.read_table(small_dataset / "index/frames.parquet").to_pylist()
    assert len(frames) == 9
    kinds = ("radiance", "truth", "clean", "final", "depth", "flow_kitti")
    for row in frames:
        for kind in kinds:
            is_last = kind == "flow_kitti" and row["frame"] == 3
            assert is_last or (small_dataset / row[kind]).is_file(), row
    assert frames[1]["time_s"] == pytest.approx(0.1)
    exposures = pq.read_table(small_dataset / "index/exposures.parquet").to_pylist()
    assert len(exposures) == 6
    assert all((small_dataset / row["counts"] / "zarr.json").is_file() for row in exposures)
    sequences = pq.read_table(small_dataset / "index/sequences.parquet").to_pylist()
    assert {json.loads(row["configuration"])["name"] for row in sequences} == {
        row["sequence"] for row in sequences
    }
