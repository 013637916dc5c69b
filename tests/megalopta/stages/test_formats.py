"""What another version of the program wrote is refused in one sentence, and older datasets open."""

import json

import pytest
import yaml
import zarr

from megalopta.cli import main as cli
from megalopta.core.errors import UserError
from megalopta.core.format_numbers import written
from megalopta.dataset.store import open_sequence
from megalopta.sensor import StoredFrames, open_counts
from megalopta.stages.ledger import Ledger

COUNTS = "counts/grating/spadcam-starlight.zarr"
STORES = (COUNTS, "results/grating/responses/spadcam-starlight.zarr")


def change(root, **values):
    path = root / "dataset.yaml"
    record = yaml.safe_load(path.read_text("utf-8"))
    path.write_text(yaml.safe_dump({**record, **values}), "utf-8")


def test_every_folder_and_store_has_its_number(whole):
    assert yaml.safe_load((whole / "dataset.yaml").read_text("utf-8"))["format"] == 1
    for name in STORES:
        attributes = zarr.open_group(whole / name, mode="r").attrs
        assert attributes["format_number"] == written("counts")


def test_a_newer_dataset_is_refused(whole_copy, capsys):
    change(whole_copy, format=99)
    for words in (("report",), ("check", "files"), ("sense",)):
        with pytest.raises(SystemExit):
            cli.main([*words, str(whole_copy)])
        told = capsys.readouterr().err
        assert "dataset format 99 is newer than 1, which this program reads; update" in told


def test_a_newer_store_is_refused(whole_copy):
    for name, array in zip(STORES, ("counts", "BM"), strict=True):
        path = whole_copy / name / "zarr.json"
        record = json.loads(path.read_text("utf-8"))
        record["attributes"]["format_number"] = 99
        path.write_text(json.dumps(record), "utf-8")
        with pytest.raises(UserError, match="counts format 99 is newer than 1"):
            StoredFrames.open(path.parent, array)
    with pytest.raises(UserError, match="counts format 99 is newer than 1"):
        open_counts(whole_copy / COUNTS)


def test_a_dataset_from_before_there_were_numbers_is_read(whole_copy):
    path = whole_copy / "dataset.yaml"
    record = yaml.safe_load(path.read_text("utf-8"))
    del record["format"]
    path.write_text(yaml.safe_dump(record), "utf-8")
    manifest = whole_copy / "manifest.jsonl"
    lines = [json.loads(line) for line in manifest.read_text("utf-8").splitlines()]
    for line in lines:
        del line["provenance"]
    manifest.write_text("".join(f"{json.dumps(line)}\n" for line in lines))
    assert Ledger(open_sequence(whole_copy)).finished() == ["render", "sense", "flow", "benchmark"]
