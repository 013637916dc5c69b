import pytest

from megalopta.core.bounded import undamaged
from megalopta.core.errors import DamagedFileError, UserError


def test_damage_inside_of_damage_gets_the_outer_remedy():
    with (
        pytest.raises(
            DamagedFileError, match=r"^a\.zarr is missing or damaged \(lacks 'x'\); run b$"
        ),
        undamaged("a.zarr", "run b"),
        undamaged("a.zarr"),
    ):
        raise KeyError("x")


def test_errors_for_users_pass():
    with pytest.raises(UserError, match="^choose one$"), undamaged("a.zarr", "run b"):
        raise UserError("choose one")
