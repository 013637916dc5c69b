"""The Croissant description, judged by the reference implementation, and the tables it names."""

import json

import pyarrow.parquet as pq
import pytest


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
