import pytest
from pydantic import TypeAdapter, ValidationError

from megalopta.scenes.meshes.reflectance import Curve, Reflectance, material_of

READ = TypeAdapter(Reflectance).validate_python


def test_a_curve_is_read_once_and_its_numbers_stay(tmp_path):
    path = tmp_path / "leaf.csv"
    path.write_text("# a leaf\nwavelength_nm,reflectance\n400, 0.05 # blue\n700,0.1\n1000,0.5\n")
    given = READ(str(path))
    path.unlink()
    assert given == Curve(wavelengths_nm=(400, 700, 1000), values=(0.05, 0.1, 0.5))
    assert READ(given.model_dump(mode="json")) == given
    assert material_of(given).known_nm == (400, 1000)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "has 0 points"),
        ("400,0.5\n", "has 1 points"),
        ("400,0.5\n700,1.5\n", "line 2: reflectance 1.5 is not from 0 to 1"),
        ("700,0.5\n400,0.5\n", "400 nm follows 700"),
        ("400,0.5,1\n", "not wavelength_nm,reflectance"),
        ("400;0.5\n", "not wavelength_nm,reflectance"),
        ("400,nan\n700,1\n", "nan is not from 0 to 1"),
    ],
)
def test_what_is_no_curve_is_refused(tmp_path, text, reason):
    path = tmp_path / "leaf.csv"
    path.write_text(text)
    with pytest.raises(ValidationError, match=reason):
        READ(str(path))
