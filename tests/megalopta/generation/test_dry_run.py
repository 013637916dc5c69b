"""What a dry run tells is near to what is made, and a dry run that is killed leaves nothing."""

import pytest

from megalopta.config.drawing import configuration_of
from megalopta.dataset.store import files_in
from megalopta.generation.dry_run import costs_of


@pytest.mark.slow
def test_the_size_told_is_within_30_percent_of_what_is_made(small_plan, small_dataset):
    drawn = [configuration_of(small_plan, index) for index in range(small_plan.sequences)]
    told = sum(each.bytes for each in costs_of(small_plan, drawn))
    books = ("index", "splits", "sequences")
    made = sum(
        path.stat().st_size
        for path in files_in([small_dataset])
        if path.relative_to(small_dataset).parts[0] not in books
    )
    assert told == pytest.approx(made, rel=0.3)
