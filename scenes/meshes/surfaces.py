"""Materials and meshes of a scene from the pieces of a file."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from megalopta.assets_gen import Surface, join
from megalopta.core.bounded import quoted
from megalopta.scenes.material import ColorTexture, Emission, Finish, Material
from megalopta.scenes.meshes.pieces import Color, Piece, Texels
from megalopta.scenes.meshes.reflectance import Curve, material_of
from megalopta.scenes.scene import Asset
from megalopta.scenes.spectra.color import BLUE, GREEN, KNOWN_NM, RED, reflectance_of_color
from megalopta.scenes.spectra.spectrum import Spectrum, flat

_WHITE: Color = (1.0, 1.0, 1.0)
_GRAY = 0.5
"""Reflectance of surfaces that are not diffuse, for viewers that know none."""


@dataclass
class Surfacing:
    """Makes assets, and collects the materials of their parts."""

    label: str
    """Beginning of the names of materials, different for each file."""
    given: Mapping[str, float | Curve | str] = field(default_factory=dict)
    """Reflectances that replace the colors of materials, by name."""
    colorless: float = 0.5
    """Reflectance of surfaces without material and colors."""
    shines: bool = False
    """True if surfaces with a radiance are lamps, and nothing else."""
    materials: dict[str, Material] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Begin without names: materials of a file may share one."""
        self._alike: dict[str, dict[tuple[object, ...], int]] = {}
        self._texels = Texels(self.label)
        for material in self.materials.values():
            if material.texture:
                self._texels.add(material.texture.weight)

    def objects(self, pieces: Sequence[Piece]) -> list[tuple[Piece, Asset]]:
        """Return the first piece and the asset of each object of a file."""
        by_number: dict[int, list[tuple[str, Surface]]] = {}
        first: dict[int, Piece] = {}
        for piece, part in zip(pieces, self._parts(pieces), strict=True):
            first.setdefault(piece.number, piece)
            by_number.setdefault(piece.number, []).append(part)
        return [(first[number], _asset(parts)) for number, parts in by_number.items()]

    def whole(self, pieces: Sequence[Piece]) -> Asset:
        """Return all objects of a file as one asset."""
        return _asset(list(self._parts(pieces)))

    def _parts(self, pieces: Sequence[Piece]) -> Iterator[tuple[str, Surface]]:
        """Name of the material and mesh of each piece."""
        for piece in pieces:
            if self.shines and piece.paint.dark:
                raise ValueError(
                    f"{self.label}: object {quoted(piece.name)!r} is a lamp {piece.paint.dark}, "
                    "which is not read; remove it, or use lights 'own'"
                )
            if self.shines and piece.paint.radiance:
                yield self._shining(piece, piece.paint.radiance)
            elif piece.material in self.given:
                yield self._part(
                    piece.material, material_of(self.given[piece.material]), _bare(piece)
                )
            elif piece.paint.refused:
                raise ValueError(
                    f"{self.label}: material {quoted(piece.material)!r} is {piece.paint.refused}, "
                    "which is not rendered; give it a diffuse reflectance in `materials`"
                )
            elif piece.paint.finish:
                finish = piece.paint.finish
                material = Material(flat(_GRAY), known_nm=finish.known_nm, finish=finish)
                surface = self._unwrapped(piece) if finish.is_patterned else _bare(piece)
                name = self._numbered(piece.material, id(finish))
                yield self._part(name, material, surface)
            elif piece.paint.picture is not None:
                paint, picture = piece.paint, piece.paint.picture
                if paint.color != _WHITE:
                    picture = picture * np.array(paint.color, np.float32)
                texture = ColorTexture(picture, (RED, GREEN, BLUE))
                material = Material(flat(0.0), texture, known_nm=KNOWN_NM)
                name = self._numbered(piece.material, id(paint))
                yield self._part(name, material, self._unwrapped(piece))
            else:
                yield self._plain(piece)

    def _part(self, name: str, material: Material, surface: Surface) -> tuple[str, Surface]:
        name = f"{self.label}: {name}{'' if surface.normals is None else ', smooth'}"
        if name not in self.materials:
            self.materials[name] = material
            if material.texture:
                self._texels.add(material.texture.weight)
        return name, surface

    def _numbered(self, name: str, *of: object) -> str:
        """Name of a material, with a number if others of the file have the same."""
        alike = self._alike.setdefault(name, {})
        number = alike.setdefault(of, len(alike))
        return f"{name} ({number + 1})" if number else name

    def _unwrapped(self, piece: Piece) -> Surface:
        if piece.uv is None:
            raise ValueError(
                f"{self.label}: object {piece.name!r} of material {piece.paint.name!r} has no "
                "texture coordinates for its picture; unwrap it, or give the material a "
                "reflectance in `materials`"
            )
        return Surface(piece.vertices, piece.faces, piece.uv, piece.normals)

    def _shining(self, piece: Piece, radiance: Spectrum) -> tuple[str, Surface]:
        """Lamp that reflects as its surface does, unless that has a picture."""
        paint, diffuse = piece.paint, self.given.get(piece.material)
        finish = paint.finish if diffuse is None else None
        if not finish and not (paint.picture is not None or paint.refused):
            if diffuse is None:
                reflectance = paint.spectrum or reflectance_of_color(paint.color)
            else:
                reflectance = material_of(diffuse).reflectance
            side = Finish("diffuse", {"reflectance": reflectance})
            finish = Finish("twosided", {"side": side}) if any(reflectance.values) else None
        spans = [(radiance.wavelengths_nm[0], KNOWN_NM[1])] if len(radiance.values) > 1 else []
        spans += [finish.known_nm] if finish and finish.known_nm else []
        ends = (max(low for low, _ in spans), min(high for _, high in spans)) if spans else None
        lamp = Material(flat(0.0), emission=Emission(radiance), known_nm=ends, finish=finish)
        surface = self._unwrapped(piece) if finish and finish.is_patterned else _bare(piece)
        kind = radiance, paint.spectrum, paint.color, id(paint.finish)
        return self._part(self._numbered(f"{piece.material}, lamp", *kind), lamp, surface)

    def _plain(self, piece: Piece) -> tuple[str, Surface]:
        paint = piece.paint
        if of := paint.spectrum:
            ends = (of.wavelengths_nm[0], of.wavelengths_nm[-1]) if len(of.values) > 1 else None
            name = self._numbered(piece.material, of)
            return self._part(name, Material(of, known_nm=ends), _bare(piece))
        if paint.name is None or not paint.is_described:
            return self._part("no color", Material(flat(self.colorless)), _bare(piece))
        material = Material(reflectance_of_color(paint.color), known_nm=KNOWN_NM)
        return self._part(self._numbered(piece.material, *paint.color), material, _bare(piece))


def check_names(given: Iterable[str], pieces: Iterable[Piece]) -> None:
    """Raise ValueError if a name is that of no material in pieces."""
    names = {piece.material for piece in pieces}
    for name in sorted({*given} - names):
        raise ValueError(
            f"materials: no material {quoted(name)!r} in the files; there are "
            f"{quoted(', '.join(sorted(names)), 400)}"
        )


def _bare(piece: Piece) -> Surface:
    """Mesh of a surface without texture."""
    return Surface(piece.vertices, piece.faces, np.zeros((len(piece.vertices), 2)), piece.normals)


def _asset(parts: Sequence[tuple[str, Surface]]) -> Asset:
    """Return an asset of surfaces by material."""
    alike: dict[str, list[Surface]] = {}
    for name, surface in parts:
        alike.setdefault(name, []).append(surface)
    return Asset({name: join(surfaces).to_mesh() for name, surfaces in alike.items()})
