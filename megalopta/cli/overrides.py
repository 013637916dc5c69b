"""Settings on the command line, such as `--scene.trees 200`, told from a verb's own options."""

from collections.abc import Callable, Collection, Sequence
from difflib import get_close_matches

from megalopta.errors import UserError

_SIMILAR = 0.7
"""From here on a word is an option mistyped; no setting is as similar to one."""


def split_overrides(
    arguments: Sequence[str], options: Collection[str], takes_list: Callable[[str], bool]
) -> tuple[list[str], dict[str, str]]:
    """Separate settings from the program's own options.

    A setting that holds one value takes one word, a list takes all words up to the next option, so
    that `render --scene.trees 200 my.yaml` renders my.yaml.

    Parameters
    ----------
    arguments : sequence of str
        As typed.
    options : collection of str
        The program's own options, such as "--out"; any other "--path" starts a setting.
    takes_list : callable
        Whether the setting at a path may hold a list.

    Returns
    -------
    own : list of str
        What is left for the program's own parser.
    overrides : dict
        Field path to a value in YAML; several words make a list.

    Raises
    ------
    UserError
        For an option that is mistyped, a setting without a value, or one that is given twice.
    """
    own: list[str] = []
    found: dict[str, list[str]] = {}
    words, is_full = own, False
    for argument in arguments:
        name, equals, value = argument.partition("=")
        words = own if is_full else words
        is_full = False
        if name in options:
            own.append(argument)
            words = own
        elif argument.startswith("--"):
            path = name.removeprefix("--").replace("-", "_")
            if not path:
                raise UserError("--: no setting; give its path, such as --camera.width")
            if near := get_close_matches(path, [each[2:] for each in options], 1, _SIMILAR):
                raise UserError(f"{name}: no such option; did you mean --{near[0]}?")
            is_list = takes_list(path)
            if path in found:
                raise UserError(f"{name}: given twice; several values follow one another")
            words = found[path] = []
            words += [value] if equals else []
            is_full = bool(equals) and not is_list
        else:
            words.append(argument)
            is_full = words is not own and not is_list
    for path, values in found.items():
        if not values:
            raise UserError(f"--{path}: needs a value")
    return own, {
        path: values[0] if len(values) == 1 else f"[{', '.join(values)}]"
        for path, values in found.items()
    }
