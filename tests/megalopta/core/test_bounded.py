import pytest
from pydantic import TypeAdapter

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


def test_of_invalid_values_the_first_is_named_in_one_line():
    wanted = TypeAdapter(list[int])
    with (
        pytest.raises(
            DamagedFileError, match=r"^a\.json is missing or damaged \(1: Input [^\n]*\); "
        ),
        undamaged("a.json"),
    ):
        wanted.validate_python([1, "x", "y"])


def test_damage_of_a_part_is_named_after_the_file_and_keeps_its_remedy():
    with (
        pytest.raises(DamagedFileError, match=r"^a\.glb: material 'x' is empty; fill it$"),
        undamaged("a.glb", "export it again"),
    ):
        raise DamagedFileError("material 'x' is empty; fill it")


def test_words_about_the_file_are_kept_and_get_the_remedy():
    with (
        pytest.raises(DamagedFileError, match=r"^a\.exr: no such file; render again$"),
        undamaged("a.exr", "render again"),
    ):
        raise FileNotFoundError("a.exr: no such file")
