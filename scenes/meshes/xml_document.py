"""Mitsuba's XML as a bounded document: no entities, defaults filled in, references resolved.

Files that it includes become part of it.

Nothing in it is loaded or executed. Names of older versions (toWorld) become those of version 3
(to_world), as Mitsuba itself does.
"""

import re
from collections.abc import Iterator, Mapping
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
_MOST_INCLUDES = 100
_MOST_FILLED = 16 * 10**6
_CAPITAL = re.compile(r"(?<=[a-z])([A-Z])")
_WORD = re.compile(r"\$(\w+)")


class Document:
    """Elements of a scene by place and by id."""

    def __init__(self, contents: Mapping[str, bytes]) -> None:
        """Raise ValueError if the first content is no scene, or more than one."""
        self._contents, self._includes, self._filled = contents, 0, 0
        self.root = _scene(next(iter(contents.values())))
        self.missing: list[str] = []
        """Names of included files that are not among the contents."""
        self._by_id: dict[str, Element] = {}
        defaults: dict[str, str] = {}
        for number, element in enumerate(self._walk(self.root, 0)):
            if number > _MOST_ELEMENTS:
                raise ValueError(f"it has more than {_MOST_ELEMENTS} elements")
            self._settle(element, defaults)
        self.root[:] = _flat(self.root)

    def parts(self, element: Element, tag: str) -> list[Element]:
        """Direct parts of an element with a tag, also those that it names by their id."""
        return [each for each in map(self.resolved, element) if each.tag == tag]

    def resolved(self, element: Element) -> Element:
        """Return an element, or what it refers to by its id."""
        if element.tag != "ref":
            return element
        wanted = element.get("id", "")
        if wanted not in self._by_id:
            raise ValueError(f"it names {quoted(wanted)!r}, which is not defined")
        return self._by_id[wanted]

    def _walk(self, element: Element, depth: int) -> Iterator[Element]:
        if depth > _DEEPEST:
            raise ValueError(f"it is nested in more than {_DEEPEST} levels")
        yield element
        if element.tag == "include":
            self._include(element)
        for each in element:
            yield from self._walk(each, depth + 1)

    def _include(self, element: Element) -> None:
        """Put the elements of another file into the element that includes it."""
        name = plain(element.get("filename", ""))
        self._includes += 1
        if self._includes > _MOST_INCLUDES:
            raise ValueError(f"it includes more than {_MOST_INCLUDES} files")
        if not name.lower().endswith(".xml"):
            raise ValueError(f"it includes {quoted(name)!r}, which is no XML file")
        if name in self._contents:
            element[:] = _scene(self._contents[name])
        else:
            self.missing.append(name)

    def _settle(self, element: Element, defaults: dict[str, str]) -> None:
        for key, value in element.attrib.items():
            if "$" in value:
                element.set(key, self._fill(value, defaults))
        if name := _CAPITAL.sub(lambda found: f"_{found[1].lower()}", element.get("name", "")):
            element.set("name", name)
        if element.tag == "default":
            defaults.setdefault(name, element.get("value", ""))
        if "id" in element.attrib and element.tag != "ref":
            self._by_id[element.attrib["id"]] = element

    def _fill(self, value: str, defaults: dict[str, str]) -> str:
        """Return a text with the defaults that it names, which may double in each of many."""

        def default(found: re.Match[str]) -> str:
            text = defaults.get(found[1], found[0])
            self._filled += len(text)
            if self._filled > _MOST_FILLED:
                raise ValueError(f"it fills {quoted(value)!r} with too long a text")
            return text

        return _WORD.sub(default, value)


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


def _flat(element: Element) -> Iterator[Element]:
    """Yield the parts of an element and, in their place, those of included files."""
    for each in element:
        if each.tag == "include":
            yield from _flat(each)
        else:
            yield each


def value_of(element: Element, tag: str, name: str) -> str:
    """Value of a property of an element; empty without it."""
    found = (each for each in element if each.tag == tag and each.get("name") == name)
    return next((each.get("value", "") for each in found), "")


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
                matrix = _step(step) @ matrix
                owner, values = element.get("id") or element.get("type", ""), dict(step.attrib)
                check_map(matrix, f"{element.tag} {quoted(owner)!r}: {step.tag} {quoted(values)}")
    return matrix


def _step(step: Element) -> Floats:
    matrix = np.eye(4)
    match step.tag:
        case "translate":
            matrix[:3, 3] = _vector(step, 0.0)
        case "scale":
            matrix[:3, :3] = np.diag(_vector(step, 1.0))
        case "rotate":
            axis, angle = _vector(step, 0.0), np.radians(float(step.get("angle", "0")))
            turn = angle * axis / np.linalg.norm(axis) if axis.any() else np.full(3, np.nan)
            matrix[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
        case "matrix":
            given = numbers_in(step.get("value", ""))
            side = 4 if given.size == 16 else 3
            matrix[:side, :side] = given.reshape(side, side)
        case "lookat":
            names = "origin", "target", "up"
            origin, target, up = (numbers_in(step.get(name, "0 0 1")) for name in names)
            ahead = (target - origin) / np.linalg.norm(target - origin)
            left = np.cross(up, ahead)
            left /= np.linalg.norm(left)
            matrix[:3] = np.stack([left, np.cross(ahead, left), ahead, origin], axis=1)
        case other:
            raise ValueError(f"it has an unknown transform {quoted(other)!r}")
    return matrix


def _vector(step: Element, usual: float) -> Floats:
    """Vector (3,) of a step: `value`, of one or three numbers, or x, y and z."""
    if "value" in step.attrib:
        return numbers_in(step.attrib["value"]) * np.ones(3)
    return np.array([float(step.get(axis, usual)) for axis in "xyz"])
