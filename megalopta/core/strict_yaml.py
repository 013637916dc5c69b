"""Strict YAML as plain data. Every folder may import this module.

It reads the core schema of YAML 1.2, where values mean what a person expects: `1e-3` is a number;
`1:30`, `yes` and `2024-01-01` are text, which YAML 1.1 reads as 90, true and a date. Two things
differ: `<<` merges mappings, as in YAML 1.1, and digits after a leading zero, such as `000731`, are
text, which a numeric field reads as decimal. Text that either version would misread is written in
quotes.
"""

import re
from typing import Any

import yaml

from megalopta.core.bounded import quoted, sentence

try:  # a hundred times as fast
    from yaml import CSafeLoader as SafeLoader
except ImportError:
    from yaml import SafeLoader  # type: ignore[assignment]

MOST_NODES = 100_000
"""Most keys and values of a text; the content of an alias counts each time."""
DEEPEST = 100
"""Deepest nesting of mappings and lists."""

_TAG = "tag:yaml.org,2002:"
_CORE = {
    "null": (r"~|null|Null|NULL|", "~nN"),
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?(0|[1-9][0-9]*)|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    "float": (
        r"[-+]?(\.[0-9]+|[0-9]+\.[0-9]*|[0-9]+(?=[eE]))([eE][-+]?[0-9]+)?"
        r"|[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)",
        "-+.0123456789",
    ),
    "merge": (r"<<", "<"),
}
"""Plain text of other types: its pattern, and its possible first characters."""
_KINDS = ("null", "bool", "int", "float", "str", "seq", "map")


class _Loader(SafeLoader):
    """Loads the core schema alone, and refuses duplicate keys, which YAML overwrites."""

    yaml_implicit_resolvers = {}  # noqa: RUF012 - a class attribute of PyYAML
    yaml_constructors = {
        tag: SafeLoader.yaml_constructors[tag] for tag in (None, *(_TAG + kind for kind in _KINDS))
    } | {
        f"{_TAG}int": lambda _, node: int(node.value, 0),
        f"{_TAG}float": lambda _, node: float(re.sub(r"\.(?=inf|nan)", "", node.value.lower())),
    }

    def get_single_node(self) -> yaml.Node | None:
        node = super().get_single_node()
        if node is not None:
            _check_extent(node, {}, 1)
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise _refused(f"duplicate key {quoted(repr(key.value))}; remove one", key)
                seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError, TypeError):  # tags are not checked earlier
            kind = node.tag.rpartition(":")[2]
            raise _refused(f"{str(node.value)[:60]!r} is no {kind}", node) from None


class _Dumper(yaml.SafeDumper):
    """Quotes text that YAML 1.1 or 1.2 would read as another type."""


for _kind, (_pattern, _first) in _CORE.items():
    for _each in (_Loader, _Dumper):
        _each.add_implicit_resolver(_TAG + _kind, re.compile(rf"(?:{_pattern})\Z"), [*_first, ""])


def load(text: str) -> Any:
    """Parse YAML. Raises ValueError with the problem and its line."""
    try:
        depth = 0
        for event in yaml.parse(text, SafeLoader):  # deep nesting would overflow the stack
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > DEEPEST:
                raise _refused("nested too deeply; flatten it", event)
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as problem:
        reason = ", ".join(part for part in (problem.context, problem.problem) if part)
        line = f" (line {problem.problem_mark.line + 1})" if problem.problem_mark else ""
        raise ValueError(f"not valid YAML: {sentence(reason)}{line}") from None
    except (yaml.YAMLError, UnicodeError) as problem:
        raise ValueError(f"not valid YAML: {sentence(str(problem))}") from None


def dump(values: Any, **style: Any) -> str:
    """Return YAML that `load` reads back, keys in order; `style` is PyYAML's."""
    style = {"sort_keys": False, "allow_unicode": True, "width": 100} | style
    return str(yaml.dump(values, Dumper=_Dumper, **style))


def _check_extent(
    node: yaml.Node, known: dict[yaml.Node, tuple[int, int]], depth: int
) -> tuple[int, int]:
    """Return the keys and values of a node, aliases each time, and its height; refuse too many."""
    if node not in known and depth <= DEEPEST:
        pairs = node.value if isinstance(node, yaml.MappingNode) else ()
        inside = (
            node.value if isinstance(node, yaml.SequenceNode) else [n for p in pairs for n in p]
        )
        parts = [_check_extent(part, known, depth + 1) for part in inside]
        nodes = min(1 + sum(part[0] for part in parts), 10 * MOST_NODES)
        known[node] = nodes, 1 + max((part[1] for part in parts), default=0)
    nodes, height = known.get(node, (1, 1))
    if depth + height > DEEPEST + 1:
        raise _refused("nested too deeply, or it contains itself; flatten it", node)
    if nodes > MOST_NODES:
        raise _refused(f"more than {MOST_NODES:,} keys and values; shorten it", node)
    return nodes, height


def _refused(problem: str, where: yaml.Node | yaml.Event) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=where.start_mark)  # type: ignore[arg-type]
