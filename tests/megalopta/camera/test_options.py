"""Every option of every verb of `megalopta spadcam`, given what cannot be."""

import pytest

from megalopta.cli.main import program

from .conftest import said_of

ODD = ("nan", "inf", "-inf", "-1", "1e300", "-1e300", "9" * 5000, "", "☃", "\x1b[31m")
VERBS = program().verbs["spadcam"].verbs
NEEDED = {
    "capture": ["--port", "/none", "--wait", "0"],
    "emulate": ["--stimulus", "nothing"],
    "calibrate": ["nowhere"],
    "compare": ["nowhere", "--device", "nothing.yaml"],
    "figures": ["nowhere@1"],
}
OPTIONS = [
    (verb, action)
    for verb in NEEDED
    for action in VERBS[verb]._actions
    if action.option_strings and action.nargs != 0
]


@pytest.mark.parametrize(
    ("verb", "action"), OPTIONS, ids=[f"{verb}{each.option_strings[0]}" for verb, each in OPTIONS]
)
def test_odd_values_are_refused_in_one_sentence(verb, action, tmp_path, monkeypatch, refused):
    """Nothing here can be done, so that what is not refused for its value is for the rest."""
    monkeypatch.chdir(tmp_path)
    for value in ODD:
        values = [value] * (action.nargs if isinstance(action.nargs, int) else 1)
        joined = f"{action.option_strings[0]}={value}"
        words = [joined] if len(values) == 1 else [action.option_strings[0], *values]
        lines = said_of(refused("spadcam", verb, *NEEDED[verb], *words))
        assert len(lines) == 1 and lines[0].startswith("megalopta: "), (words, lines)
    assert not list(tmp_path.rglob("*.yaml"))
