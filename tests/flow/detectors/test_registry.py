"""What every detector in the registry promises; detectors that are named by where they are."""

import sys

import numpy as np
import pytest

from megalopta.flow.detectors.registry import METHODS, method

DETECTORS = [pytest.param(detector, id=name) for name, detector in METHODS.items()]
VELOCITY = [name for name, detector in METHODS.items() if detector.gives == "velocity"]


def counts(shape=(4, 30, 40), mean=4.0):
    return np.random.default_rng(0).poisson(mean, shape).astype(np.uint16)


@pytest.mark.parametrize("detector", DETECTORS)
def test_response_has_the_documented_shape(detector):
    frames = counts()
    responses = detector.respond(frames)
    np.testing.assert_array_equal(frames, counts())  # they are left as they are
    if detector.gives == "response":
        assert responses.shape == (4, 30, 40)
    else:
        grid = detector.grid((30, 40))
        assert responses.shape == (3, grid.rows, grid.columns, 2)
    assert responses.dtype == np.float64


@pytest.mark.parametrize("detector", DETECTORS)
def test_response_does_not_depend_on_the_cutting_into_chunks(detector):
    frames = counts()
    whole = detector.respond(frames, 0.25)
    respond = detector.start((30, 40))
    parts = [respond(each, 0.25) for each in np.split(frames, [1, 3])]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@pytest.mark.parametrize("detector", DETECTORS)
def test_scale_multiplies_the_frames_unless_they_must_be_counts(detector):
    frames = counts()
    scaled = frames if detector.takes_counts else frames * 0.125
    np.testing.assert_allclose(detector.respond(frames, 0.125), detector.respond(scaled), rtol=1e-9)


@pytest.mark.parametrize("detector", DETECTORS)
def test_offset_changes_the_response_exactly_when_the_detector_says_so(detector):
    frames = counts().astype(np.float64)
    same = np.allclose(
        detector.respond(frames + 8), detector.respond(frames), atol=1e-9, equal_nan=True
    )
    assert same == detector.ignores_offset


@pytest.mark.parametrize("detector", DETECTORS)
def test_frames_too_small_too_few_or_none_are_refused(detector):
    for shape, sentence in (
        ((3, 2, 50), "2 × 50 px"),
        ((3, 50, 2), "50 × 2 px"),
        ((30, 30), r"needs a sequence \(T, H, W\)"),
        *([((1, 30, 30), "at least 2 frames")] if detector.gives == "velocity" else []),
    ):
        with pytest.raises(ValueError, match=sentence):
            detector.respond(np.ones(shape))


@pytest.mark.parametrize("name", [name for name in VELOCITY if name != "BM"])
def test_darkness_has_no_velocity(name):
    assert np.isnan(METHODS[name].respond(np.zeros((3, 60, 60), np.uint16))[:, 1:]).all()


def test_a_function_of_a_module_in_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "reference_flow.py").write_text(
        "import numpy as np\n"
        "from megalopta.flow.detectors.registry import METHODS\n"
        "def right(a, b):\n    return np.full((*a.shape, 2), [1.0, 0.0])\n"
        "known = METHODS['BM']\n"
    )
    first, second = counts()[:2]
    right = method("reference_flow:right")
    assert right.name == "reference_flow:right"
    np.testing.assert_array_equal(right.dense(first, second)[5, 5], [1, 0])
    assert method("reference_flow:known").name == "BM"
    assert method("reference_flow.py:right").function is right.function


@pytest.fixture
def in_folder(tmp_path, monkeypatch):
    """Makes the folder of modules the working folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / "fails_to_load.py").write_text("import sys; sys.exit('no\\nlicense')")
    (tmp_path / "json.py").write_text("raise SystemExit('shadowed')")
    (tmp_path / "picture.py").write_bytes(b"\x89PNG\0")


@pytest.mark.parametrize(
    ("reference", "told"),
    [
        ("no_such_module:flow", "No module named"),
        ("math:pi", "is not a function"),
        ("picture.py:flow", "picture.py is not Python"),
        ("os:system", "give a function of two frames"),
        ("fails_to_load:flow", "no license; give the name of a module"),
        ("..:flow", "give the name of a module"),
        ("json:flow", "no attribute 'flow'"),  # of Python's own module
    ],
)
def test_code_that_is_no_method_is_told_in_one_sentence(in_folder, reference, told):
    with pytest.raises(ValueError, match=told) as problem:
        method(reference)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize("reference", ["fails_to_load:flow", "net.onnx"])
def test_code_is_looked_for_only_where_it_is_allowed(in_folder, reference):
    with pytest.raises(ValueError, match="or run code that a file names by --allow-code"):
        method(reference, allows_code=False)
    assert "fails_to_load" not in sys.modules
