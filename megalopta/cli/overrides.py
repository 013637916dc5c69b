"""Settings on the command line, such as `--scene.trees 200`, told from a verb's own options."""

from collections.abc import Callable, Collection, Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING

from megalopta.core.errors import UserError

if TYPE_CHECKING:
    from megalopta.config.settings import Words

_SIMILAR = 0.7
"""From here on a word is an option mistyped; no setting is as similar to one."""


def split_overrides(
    arguments: Sequence[str], options: Collection[str], takes: "Callable[[str], Words]"
) -> tuple[list[str], dict[str, str]]:
    """Separate the program's own options and words from settings: path to a value in YAML.

    A setting that holds one value takes one word, a list takes all words up to the next option, a
    switch only "true" or "false", so that `render --scene.trees 200 my.yaml` renders my.yaml. Any
    "--path" that is none of the options starts a setting; `takes` says how many words it takes.

    Raises
    ------
    UserError
        For an option that is mistyped, a setting without a value, or one that is given twice.
    """
    own: list[str] = []
    found: dict[str, list[str]] = {}
    taker, words = "", "one"  # the setting that takes the words that follow, and how many
    for argument in arguments:
        name, equals, value = argument.partition("=")
        if value == "--":  # which argparse drops in silence
            raise UserError(f"{name}: '--' is no value; give one")
        if name in options:
            own.append(argument)
            taker = ""
        elif argument.startswith("--"):
            taker = _path_of(name, options)
            words = takes(taker)
            if taker in found:
                raise UserError(f"{name}: given twice; several values follow one another")
            found[taker] = [value] if equals else ["true"] if words == "switch" else []
            taker = "" if equals and words != "all" else taker
        elif taker and words == "switch":
            if argument in ("true", "false"):
                found[taker] = [argument]
            else:
                own.append(argument)
            taker = ""
        elif taker:
            found[taker].append(argument)
            taker = taker if words == "all" else ""
        else:
            own.append(argument)
    return own, {path: _as_yaml(path, values) for path, values in found.items()}


def _path_of(name: str, options: Collection[str]) -> str:
    path = name.removeprefix("--").replace("-", "_")
    if not path:
        raise UserError("--: no setting; give its path, such as --camera.width")
    if near := get_close_matches(path, [each[2:] for each in options], 1, _SIMILAR):
        raise UserError(f"{name}: no such option; did you mean --{near[0]}?")
    return path


def _as_yaml(path: str, values: Sequence[str]) -> str:
    """The values of a setting; several make a list."""
    if not values:
        raise UserError(f"--{path}: needs a value")
    return values[0] if len(values) == 1 else f"[{', '.join(values)}]"
