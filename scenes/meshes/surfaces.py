"""Materials and meshes of a scene from the pieces of a file."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from megalopta.assets_gen import Surface, join
from megalopta.core.bounded import quoted
from megalopta.scenes.material import Emission, Finish, Material
from megalopta.scenes.meshes.pieces import Piece
from megalopta.scenes.meshes.reflectance import Curve, material_of
from megalopta.scenes.scene import Asset
from megalopta.scenes.spectra.color import KNOWN_NM
from megalopta.scenes.spectra.spectrum import Spectrum, flat


@dataclass
class Surfacing:
    """Makes assets, and collects the materials of their parts."""

    label: str
    """Beginning of the names of materials, different for each file."""
    given: Mapping[str, float | Curve | str] = field(default_factory=dict)
    """Reflectances that replace the colors of materials, by name."""
    colorless: float = 0.5
    """Reflectance of surfaces without material and colors."""
    materials: dict[str, Material] = field(default_factory=dict)
    _alike: dict[str, dict[object, int]] = field(default_factory=dict)
    """Numbers of the materials that share a name."""

    def objects(self, pieces: Sequence[Piece]) -> list[tuple[Piece, Asset]]:
        """Return the first piece and the asset of each object of a file."""
        objects: dict[int, list[tuple[str, Surface]]] = {}
        first: dict[int, Piece] = {}
        for piece in pieces:
            first.setdefault(piece.number, piece)
            objects.setdefault(piece.number, []).append(self._part(piece))
        return [(first[number], _asset(parts)) for number, parts in objects.items()]

    def whole(self, pieces: Sequence[Piece]) -> Asset:
        """Return all objects of a file as one asset."""
        return _asset([self._part(piece) for piece in pieces])

    def _part(self, piece: Piece) -> tuple[str, Surface]:
        """Name of a piece's material, and its mesh."""
        name, paint, reflectance = piece.material, piece.paint, self.given.get(piece.material)
        material = paint.material if reflectance is None else material_of(reflectance)
        kind: object = material  # by which materials of one name are the same
        if material:
            kind = id(material) if material.texture or material.finish else material.reflectance
        if paint.radiance:
            name, kind = f"{name}, lamp", (paint.radiance, kind)
            material = _lamp(paint.radiance, material)
        elif material and reflectance is not None:
            kind = None
        elif paint.refused:
            raise ValueError(
                f"{self.label}: material {quoted(name)!r} is {paint.refused}, "
                "which is not rendered; give it a diffuse reflectance in `materials`"
            )
        elif material is None:
            name, material = "no color", Material(flat(self.colorless))
        if kind is not None:  # others of the file may have the name
            alike = self._alike.setdefault(name, {})
            number = alike.setdefault(kind, len(alike))
            name = f"{name} ({number + 1})" if number else name
        uv = np.zeros((len(piece.vertices), 2))
        if material.texture or (material.finish and material.finish.is_patterned):
            if piece.uv is None:
                raise ValueError(
                    f"{self.label}: object {piece.name!r} of material {paint.name!r} has no "
                    "texture coordinates for its picture; unwrap it, or give the material a "
                    "reflectance in `materials`"
                )
            uv = piece.uv
        name = f"{self.label}: {name}{'' if piece.normals is None else ', smooth'}"
        self.materials.setdefault(name, material)
        return name, Surface(piece.vertices, piece.faces, uv, piece.normals)


def _lamp(radiance: Spectrum, surface: Material | None) -> Material:
    """Lamp that reflects as its surface does, unless that has a picture or is not rendered."""
    finish = surface.finish if surface else None
    if surface and not (finish or surface.texture) and any(surface.reflectance.values):
        side = Finish("diffuse", {"reflectance": surface.reflectance})
        finish = Finish("twosided", {"side": side})
    spans = [(radiance.wavelengths_nm[0], KNOWN_NM[1])] if len(radiance.values) > 1 else []
    spans += [finish.known_nm] if finish and finish.known_nm else []
    ends = (max(low for low, _ in spans), min(high for _, high in spans)) if spans else None
    return Material(flat(0.0), emission=Emission(radiance), known_nm=ends, finish=finish)


def check_names(given: Iterable[str], pieces: Iterable[Piece]) -> None:
    """Raise ValueError if a name is that of no material in pieces."""
    names = {piece.material for piece in pieces}
    for name in sorted({*given} - names):
        raise ValueError(
            f"materials: no material {quoted(name)!r} in the files; there are "
            f"{quoted(', '.join(sorted(names)), 400)}"
        )


def _asset(parts: Sequence[tuple[str, Surface]]) -> Asset:
    """Return an asset of surfaces by material."""
    alike: dict[str, list[Surface]] = {}
    for name, surface in parts:
        alike.setdefault(name, []).append(surface)
    return Asset({name: join(surfaces).to_mesh() for name, surfaces in alike.items()})
