"""Where products lie, and which exposure a file is of."""

from pathlib import Path

import pytest

from megalopta.sensor.formats.products import PRODUCTS, product_path, product_stem


@pytest.mark.parametrize("product", PRODUCTS)
def test_the_exposure_of_every_product_is_read_back(product):
    counts = Path("counts") / "000001" / "spad.fast-0.1lux.zarr"
    assert product_stem(product_path(counts, product)) == "spad.fast-0.1lux"
