"""YAML as plain data, without what YAML lets pass. Every folder may import this module."""

from collections.abc import Iterator, Mapping
from typing import Any

import yaml
from pydantic import BaseModel


class _Loader(yaml.SafeLoader):
    """Refuses a key that comes twice, of which YAML would take the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    raise _refused(f"the key {key.value!r} comes twice; leave one out", key)
                seen.add((key.tag, key.value))
        return super().construct_mapping(node, deep)

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, LookupError, AttributeError, TypeError):  # tags are not checked before
            kind = node.tag.rpartition(":")[2]
            raise _refused(f"{str(node.value)[:60]!r} is no {kind}", node) from None


def load(text: str) -> Any:
    """Read YAML.

    Raises
    ------
    ValueError
        With the problem and its line.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as problem:
        told = ", ".join(part for part in (problem.context, problem.problem) if part)
        line = f" (line {problem.problem_mark.line + 1})" if problem.problem_mark else ""
        raise ValueError(f"not valid YAML: {told}{line}") from None
    except yaml.YAMLError as problem:
        raise ValueError(f"not valid YAML: {' '.join(str(problem).split())}") from None
    except RecursionError:
        raise ValueError("nested too deeply; write it flatter") from None


def booleans_for_others(values: Any, record: Any, place: str = "") -> Iterator[str]:
    """Places where a boolean was given and something else was made of it, such as 1 of true."""
    if isinstance(values, bool) and not isinstance(record, bool):
        yield place
    elif isinstance(values, Mapping) and isinstance(record, BaseModel | Mapping):
        parts = record if isinstance(record, Mapping) else vars(record)
        for key in values.keys() & parts.keys():
            yield from booleans_for_others(values[key], parts[key], f"{place}.{key}".strip("."))
    elif isinstance(values, list | tuple) and isinstance(record, list | tuple):
        for index, pair in enumerate(zip(values, record, strict=False)):
            yield from booleans_for_others(*pair, f"{place}.{index}".strip("."))


def _refused(problem: str, node: yaml.Node) -> yaml.MarkedYAMLError:
    return yaml.MarkedYAMLError(problem=problem, problem_mark=node.start_mark)
