"""Mitsuba's XML as a bounded document: no entities, defaults filled in, references resolved.

Nothing is executed. Names of older versions (toWorld) become those of version 3 (to_world).
"""

import re
from collections.abc import Iterator
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats
from megalopta.core.bounded import quoted
from megalopta.scenes.meshes.pieces import check_map

Element = ElementTree.Element

_MOST_BYTES = 16 * 10**6
_MOST_ELEMENTS = 10**6
_DEEPEST = 40
_CAPITAL = re.compile(r"(?<=[a-z])([A-Z])")


class Document:
    """Elements of a scene by place and by id."""

    def __init__(self, content: bytes) -> None:
        """Raise ValueError if the content is no scene."""
        self.root, self._filled = _scene(content), 0
        self._by_id: dict[str, Element] = {}
        defaults: dict[str, str] = {}
        for number, element in enumerate(_walk(self.root, 0)):
            if number > _MOST_ELEMENTS:
                raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
            for key, value in element.attrib.items():
                if "$" in value:
                    element.set(key, self._fill(value, defaults))
            if name := _CAPITAL.sub(lambda found: f"_{found[1].lower()}", element.get("name", "")):
                element.set("name", name)
            if element.tag == "default":
                defaults.setdefault(name, element.get("value", ""))
            if "id" in element.attrib and element.tag != "ref":
                self._by_id[element.attrib["id"]] = element

    def parts(self, element: Element, tag: str) -> list[Element]:
        """Direct parts of an element with a tag, also those that it names by their id."""
        return [part for part in map(self.resolved, element) if part.tag == tag]

    def resolved(self, element: Element) -> Element:
        """Return an element, or what it refers to by its id."""
        if element.tag != "ref":
            return element
        name = element.get("id", "")
        if name not in self._by_id:
            raise ValueError(f"it names {quoted(name)!r}, which is not defined")
        return self._by_id[name]

    def _fill(self, value: str, defaults: dict[str, str]) -> str:
        """Return a text with the defaults that it names, which may double in each of many."""

        def default(found: re.Match[str]) -> str:
            text = defaults.get(found[1], found[0])
            self._filled += len(text)
            if self._filled > 16 * 10**6:  # characters filled in
                raise ValueError(f"it fills {quoted(value)!r} with too long a text")
            return text

        return re.sub(r"\$(\w+)", default, value)


def _scene(content: bytes) -> Element:
    """Return the outermost element of an XML file. Raises ValueError if it is no scene."""
    if len(content) > _MOST_BYTES:
        raise ValueError(f"its XML is larger than {_MOST_BYTES / 1e6:.0f} MB")
    if b"\0" in content:
        raise ValueError("its XML is not UTF-8")
    if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
        raise ValueError("it defines entities, which are not read")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as problem:
        raise ValueError(f"it is no XML: {problem}") from None
    if root.tag != "scene":
        raise ValueError(f"its outermost element is {quoted(root.tag)!r}, not 'scene'")
    return root


def _walk(element: Element, depth: int) -> Iterator[Element]:
    if depth > _DEEPEST:
        raise ValueError(f"it is nested in more than {_DEEPEST} levels")
    if element.tag == "include":
        raise ValueError("it includes another file, which is not read; put its elements here")
    yield element
    for part in element:
        yield from _walk(part, depth + 1)


def value_of(element: Element, tag: str, name: str) -> str:
    """Value of a property of an element; empty without it."""
    properties = (part for part in element if part.tag == tag and part.get("name") == name)
    return next((part.get("value", "") for part in properties), "")


def plain(name: str) -> str:
    """Name of a file, with slashes, as Windows names it too."""
    return name.strip().replace("\\", "/")


def numbers_in(text: str) -> Floats:
    """Numbers (n,) in a text, separated by commas or spaces."""
    return np.array(text.replace(",", " ").split(), np.float64)


def transform_of(element: Element, name: str = "to_world") -> Floats:
    """Matrix (4, 4) of a transform of an element; its steps act one after the other."""
    matrix = np.eye(4)
    for transform in element:
        if transform.tag == "transform" and transform.get("name") == name:
            for step in transform:
                change = np.eye(4)
                match step.tag:
                    case "translate":
                        change[:3, 3] = _vector(step, 0.0)
                    case "scale":
                        change[:3, :3] = np.diag(_vector(step, 1.0))
                    case "rotate":
                        axis = _vector(step, 0.0)
                        angle = np.radians(float(step.get("angle", "0")))
                        length = np.linalg.norm(axis)
                        turn = angle * axis / length if axis.any() else np.full(3, np.nan)
                        change[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
                    case "matrix":
                        numbers = numbers_in(step.get("value", ""))
                        side = 4 if numbers.size == 16 else 3
                        change[:side, :side] = numbers.reshape(side, side)
                    case other:
                        raise ValueError(f"it has an unknown transform {quoted(other)!r}")
                matrix = change @ matrix
                owner, values = element.get("id") or element.get("type", ""), dict(step.attrib)
                check_map(matrix, f"{element.tag} {quoted(owner)!r}: {step.tag} {quoted(values)}")
    return matrix


def _vector(step: Element, usual: float) -> Floats:
    """Vector (3,) of a step: `value`, of one or three numbers, or x, y and z."""
    if "value" in step.attrib:
        return numbers_in(step.attrib["value"]) * np.ones(3)
    return np.array([float(step.get(axis, usual)) for axis in "xyz"])
