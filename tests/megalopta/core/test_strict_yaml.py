"""YAML as people mean it, and within bounds."""

import math

import pytest

from megalopta.core import strict_yaml

from ..harm import BOMB


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1:2:3", "1:2:3"),
        ("0o10", 8),
        ("0x1F", 31),
        ("+12", 12),
        ("1e-3", 1e-3),
        ("-.5", -0.5),
        ("-.inf", -math.inf),
        ("yes", "yes"),
        ("true", True),
        ("~", None),
        ("2024-01-01", "2024-01-01"),
        ("1_000", "1_000"),
        ("000731", "000731"),
    ],
)
def test_plain_values_are_those_of_yaml_1_2(text, value):
    found = strict_yaml.load(f"- {text}")[0]
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    "text", ["1e3", "yes", "010", "0o7", "1:2", "2024-01-01", "", "~", "=", "☃"]
)
def test_text_is_written_so_that_it_is_read_back_as_text(text):
    assert strict_yaml.load(strict_yaml.dump({text: [text]})) == {text: [text]}


@pytest.mark.parametrize("tag", ["set", "timestamp", "binary", "omap", "python/name:os.system"])
def test_only_the_core_schema_has_tags(tag):
    with pytest.raises(ValueError, match="tag"):
        strict_yaml.load(f"!!{tag} x")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BOMB, "more than 100,000 keys and values; shorten it .line 6"),
        (f"x: [{', '.join(['1'] * 100_001)}]", "more than 100,000"),
        ("a: &a {x: *a}", "contains itself; flatten it .line 1"),
        ("a: &a {<<: *a}", "contains itself"),
        ("[" * 100_000, "nested too deeply; flatten it|maximum nesting depth"),
        ("- &a [x]\n" + "".join(f"- &a{'b' * n} [*a{'b' * (n - 1)}]\n" for n in range(1, 200)),
         "nested too deeply"),
        (f"? {'k' * 10_000}\n: 1\n? {'k' * 10_000}\n: 2", "duplicate key"),
        (f"a: *{'k' * 10_000}", "undefined alias"),
        ("a:\n  b: 4\n  c: 4\n  b: 5\n", "not valid YAML: duplicate key 'b'; remove one .line 4"),
        ("a: !!int x", "'x' is no int .line 1"),
        ("a: \0", "not valid YAML"),
    ],
)  # fmt: skip
def test_what_is_no_yaml_or_unfolds_to_too_much_is_refused_in_a_short_sentence(text, message):
    with pytest.raises(ValueError, match=message) as problem:
        strict_yaml.load(text)
    assert len(str(problem.value)) < 1000


def test_an_alias_repeats_and_a_merge_fills_in():
    text = "box: &box {size: 1, mass: 2}\nothers: [*box, {<<: *box, size: 3}]"
    box = {"size": 1, "mass": 2}
    assert strict_yaml.load(text) == {"box": box, "others": [box, {"size": 3, "mass": 2}]}
