import pytest
from pydantic import TypeAdapter

from megalopta.core.bounded import check_count, check_decoded, undamaged
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


def test_words_about_the_file_do_not_name_it_twice():
    with (
        pytest.raises(
            DamagedFileError, match=r"^a\.exr is missing or damaged \(no such file\); render again$"
        ),
        undamaged("a.exr", "render again"),
    ):
        raise FileNotFoundError("a.exr: no such file")


def test_content_beyond_the_budget_is_refused_with_its_size_and_the_setting(monkeypatch):
    check_decoded("a.png", (1000, 1000, 3), 8)
    with pytest.raises(UserError, match=r"^a\.png takes 24 GB .*MEGALOPTA_DECODED_GB"):
        check_decoded("a.png", (10**9, 3), 8)
    monkeypatch.setenv("MEGALOPTA_DECODED_GB", "25")
    check_decoded("a.png", (10**9, 3), 8)


def test_more_things_than_a_reader_is_meant_for_are_refused():
    check_count("a.glb", "nodes", 10, 10)
    with pytest.raises(UserError, match=r"^a\.glb holds 11 nodes; at most 10 are read$"):
        check_count("a.glb", "nodes", 11, 10)
