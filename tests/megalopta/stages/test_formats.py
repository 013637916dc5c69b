"""What another version of the program wrote is refused in one sentence, and older datasets open."""

import json

import pytest
import yaml

from megalopta.core.errors import UserError
from megalopta.sensor import StoredFrames, open_counts

COUNTS = "counts/grating/spadcam-starlight.zarr"
STORES = (COUNTS, "results/grating/responses/spadcam-starlight.zarr")


def change(root, **values):
    path = root / "dataset.yaml"
    record = yaml.safe_load(path.read_text("utf-8"))
    path.write_text(yaml.safe_dump({**record, **values}), "utf-8")


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (99, "newer than 2, the newest that this program reads; update"),
        (1, "older than 2, the oldest that this program reads; read it with the"),
    ],
)
def test_another_dataset_is_refused_with_the_way_to_its_data(whole_copy, refused, number, told):
    change(whole_copy, format=number)
    for words in (("report",), ("check", "files"), ("sense",)):
        assert f"format {number} is {told}" in refused(*words, whole_copy)


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
