"""Nodes of a glTF 2.0 file (Khronos Group) as objects; errors of any kind mean a damaged file.

trimesh names parts at random, and rounds colors to eight bits.
"""

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import check_count, check_decoded, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes import animation, gltf_file, gltf_surfaces
from megalopta.scenes.meshes.gltf_file import GltfFile, Json, extension, parts_of
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, Piece, Unused, check_map, check_triangles
from megalopta.scenes.scene import Lamp

LIGHTS = "KHR_lights_punctual"
_TRIANGLES, _STRIP, _FAN, _REPEAT = 4, 5, 6, 10497
_SHARES, _MOST_SETS, _MOST_BONES = "weights", 4, 1000

Part = tuple[Piece, Json, Mapping[str, NDArray[Any]]]
"""Piece of a primitive, and its entry and attributes."""


def names_in(name: str, content: bytes) -> list[str]:
    """Names of the files with buffers and colors that a file names. Raises any exception."""
    if not name.lower().endswith((".glb", ".gltf")):
        return []
    header, _ = parts_of(content)
    materials = header.get("materials", ())
    textures = (
        entry for material in materials for entry in gltf_surfaces.pictures_of(material).values()
    )
    images = [header["images"][gltf_file.image_of(header, texture)] for texture in textures]
    buffers = [entry for entry in header.get("buffers", ()) if not gltf_file.stands_in(entry)]
    uris = [entry["uri"] for entry in [*buffers, *images] if "uri" in entry]
    return [unquote(uri) for uri in uris if not uri.startswith("data:")]


def pieces_of(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Piece]:
    """Yield the pieces of a file's nodes. Raises any exception if the file is damaged.

    If "animation" is used, they move as the file's first animation tells.
    """
    file, plays = GltfFile(contents), "animation" in used
    for things in ("nodes", "meshes", "materials", "textures", "images", "skins", "buffers"):
        check_count(file.name, things, len(file.header.get(things, ())), MOST_OBJECTS)
    nodes, looks = _Nodes(file, plays), gltf_surfaces.Looks(file, "lights" in used)
    count, size, is_moving = 0, 0, False
    for number, pose in nodes.poses.items():
        if "mesh" not in nodes.entries[number]:
            continue
        parts = []
        for part in _parts(file, number, looks):
            count, (piece, entry, values) = count + 1, part
            copies = 1 + len(values) // 4 + 2 * len(entry.get("targets", ()))
            size += len(piece.faces) + len(piece.vertices) * copies // 2
            check_count(file.name, "objects", count, MOST_OBJECTS)
            check_triangles(file.name, size)
            parts.append(part)
        if "skin" in nodes.entries[number] or any(entry.get("targets") for _, entry, _ in parts):
            pieces = _figure(file, number, parts, nodes)
        else:
            motion = nodes.motion(number)
            pieces = [replace(piece.moved(pose), motion=motion) for piece, _, _ in parts]
        is_moving |= any(piece.motion for piece in pieces)
        yield from pieces
    if plays and not is_moving:
        raise DamagedFileError("it has no animation of nodes with meshes; omit animate")


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect, if "animation" is used or not. Raises any exception."""
    header, _ = parts_of(next(iter(contents.values())))
    shown, playing, shines = header.get("scene", 0), "animation" in used, "lights" in used

    def named(kind: str, plural: str) -> list[tuple[str, Json]]:
        entries = enumerate(header.get(plural, ()))
        return [(str(entry.get("name") or f"{kind} {n}"), entry) for n, entry in entries]

    effective = *gltf_file.EFFECTIVE, *gltf_surfaces.EFFECTIVE, *[LIGHTS] * shines
    scenes, clips = named("scene", "scenes"), named("animation", "animations")
    extensions = [name for name in header.get("extensionsUsed", ()) if name not in effective]
    yield from (("extensions", name) for name in extensions)
    yield from (("cameras", name) for name, _ in named("camera", "cameras"))
    yield from (("other scenes", name) for n, (name, _) in enumerate(scenes) if n != shown)
    yield from (("animations", name) for name, _ in clips[playing:])
    for name, material in named("material", "materials"):
        yield from ((feature, name) for feature in gltf_surfaces.unused_of(material, shines))
    for name, mesh in named("mesh", "meshes"):
        for part in mesh["primitives"]:
            if part.get("mode", _TRIANGLES) < _TRIANGLES:
                yield "points and lines", name
            elif "COLOR_0" in part["attributes"] and not _is_colored(header, part):
                yield "colors of vertices below pictures", name
    for sampler in header.get("samplers", ()):
        if {sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)} != {_REPEAT}:
            yield "pictures' clamping and mirroring", ""
    for lamp in extension(header, LIGHTS).get("lights", ()) if shines else ():
        if "range" in lamp:
            yield "ranges of lamps", str(lamp.get("name", ""))
    for _, clip in clips[:playing]:
        for target in (channel["target"] for channel in clip["channels"]):
            if target["path"] not in (*animation.AT_REST, _SHARES) or "node" not in target:
                yield "an animation's extensions", target["path"]
        if lit := [node for node in header.get("nodes", ()) if extension(node, LIGHTS) and shines]:
            yield "motion of lamps", str(lit[0].get("name", ""))


def lamps_of(contents: Mapping[str, bytes]) -> list[Lamp]:
    """Return the lamps of a file's nodes, at rest. Raises any exception if the file is damaged."""
    header, _ = parts_of(next(iter(contents.values())))
    nodes, lamps = header.get("nodes", []), []
    for number, pose in _poses(header).items():
        if (light := extension(nodes[number], LIGHTS)) and "light" in light:
            lamp = extension(header, LIGHTS)["lights"][light["light"]]
            kind, cone = lamp["type"], lamp.get("spot", {})
            color = np.clip(np.asarray(lamp.get("color", np.ones(3)), np.float64), 0, 1)
            angles = cone.get("innerConeAngle", 0.0), cone.get("outerConeAngle", math.pi / 4)
            if kind not in ("point", "spot", "directional") or not 0 <= angles[0] < angles[1] < 1.6:
                raise ValueError(f"node {number} is a lamp of type {quoted(kind)}, or of no angle")
            shining = gltf_surfaces.light_of(color, float(lamp.get("intensity", 1.0)))
            lamps.append(Lamp(kind, shining, pose, tuple(np.degrees(angles).tolist())))
    return lamps


def _joint(node: Json, tracks: animation.Joint) -> animation.Joint:
    if "matrix" in node and not tracks:
        return {"matrix": animation.fixed(node["matrix"])}
    stated = {part: node.get(part, usual) for part, usual in animation.AT_REST.items()}
    return {part: animation.fixed(value) for part, value in stated.items()} | dict(tracks)


def _poses(header: Json) -> dict[int, Floats]:
    """Pose (4, 4) of each node of the scene, by its number."""
    nodes = header.get("nodes", [])
    if "scenes" in header:
        roots = header["scenes"][header.get("scene", 0)].get("nodes", [])
    else:
        roots = set(range(len(nodes))) - {i for node in nodes for i in node.get("children", ())}
    waiting = [(number, np.eye(4)) for number in roots]
    poses: dict[int, Floats] = {}
    while waiting:
        number, above = waiting.pop()
        if number in poses:
            raise ValueError(f"node {number} has two parents")
        poses[number] = above @ animation.poses_of(_joint(nodes[number], {}), np.zeros(1))[0]
        place = f"the place of node {number} ({quoted(nodes[number])})"
        check_map(poses[number], place, may_flatten=True)
        waiting += [(child, poses[number]) for child in nodes[number].get("children", ())]
    return dict(sorted(poses.items()))


class _Nodes:
    """Nodes of a file's scene, with the tracks of its first animation if it plays."""

    def __init__(self, file: GltfFile, plays: bool) -> None:
        self.entries, self.poses = file.header.get("nodes", []), _poses(file.header)
        self._name, self._steps = file.name, 0
        self._above = {
            child: node for node in self.poses for child in self.entries[node].get("children", ())
        }
        self._tracks = dict[int, dict[str, animation.Track]]()
        self.shares = dict[int, animation.Track]()
        """Shares of the shapes of nodes' meshes over time."""
        for clip in file.header.get("animations", ())[:1] if plays else ():
            for channel in clip["channels"]:
                target, sampler = channel["target"], clip["samplers"][channel["sampler"]]
                if target["path"] not in (*animation.AT_REST, _SHARES) or "node" not in target:
                    continue  # what an extension points at
                times = file.values(sampler["input"])[:, 0]
                values = file.values(sampler["output"]).astype(np.float64)
                mode = sampler.get("interpolation", "LINEAR")
                shape = (3, -1) if mode == "CUBICSPLINE" else (-1,)
                track = animation.Track(times, values.reshape(len(times), *shape), mode)
                if target["path"] == _SHARES:
                    self.shares[target["node"]] = track
                else:
                    self._tracks.setdefault(target["node"], {})[target["path"]] = track

    def skeletons(self, bones: list[int], to_bone: Floats) -> list[animation.Skeleton]:
        """Return some nodes with all above them, at rest and, if they move, in motion.

        Raises ValueError if they leave space.
        """
        order = dict[int, int]()
        for bone in bones:
            chain = [bone]
            while chain[-1] in self._above and chain[-1] not in order:
                chain.append(self._above[chain[-1]])
            for step in chain[::-1]:
                order.setdefault(step, len(order))
        self._steps += len(order)
        check_count(self._name, "nodes above moving ones", self._steps, 100_000)
        above = tuple(order.get(self._above.get(step, -1), -1) for step in order)
        at_bones, skeletons = np.array([order[bone] for bone in bones]), []
        played: list[Mapping[int, animation.Joint]] = [{}]
        for tracks in [*played, self._tracks][: 1 + bool(self._tracks.keys() & order.keys())]:
            joints = tuple(_joint(self.entries[step], tracks.get(step, {})) for step in order)
            skeleton = animation.Skeleton(joints, above, at_bones, to_bone)
            keys = [track.times_s for joint in joints for track in joint.values()]
            times = np.unique(np.concatenate(keys))
            check_decoded(self._name, (len(times), len(order) + len(bones)), 400)  # bytes of a pose
            if not np.isfinite(skeleton.maps(times)).all():
                raise ValueError("its animation leads to places that are not finite")
            skeletons.append(skeleton)
        return skeletons

    def motion(self, number: int) -> animation.NodeMotion | None:
        """Return the motion of a node; None if it does not move."""
        if not self._tracks:
            return None
        _, *moving = self.skeletons([number], np.eye(4)[np.newaxis])
        if moving and np.linalg.det(self.poses[number][:3, :3]) == 0:
            raise ValueError(f"node {number} moves, but has no size at rest")
        return (
            animation.NodeMotion(moving[0].joints, self.poses[number], np.eye(4))
            if moving
            else None
        )


def _figure(file: GltfFile, number: int, parts: list[Part], nodes: _Nodes) -> list[Piece]:
    """Pieces of a skinned or morphed node, as its file poses it, with the motion of all."""
    node, mesh = nodes.entries[number], file.header["meshes"][nodes.entries[number]["mesh"]]
    bones, to_bone, sets = [number], np.eye(4)[np.newaxis], list[int]()
    if "skin" in node:
        skin = file.header["skins"][node["skin"]]
        bones, attributes = skin["joints"], {name for _, _, values in parts for name in values}
        check_count(file.name, "joints of a skin", len(bones), _MOST_BONES)
        to_bone = np.tile(np.eye(4), (len(bones), 1, 1))
        if "inverseBindMatrices" in skin:
            columns = file.values(skin["inverseBindMatrices"])[: len(bones)]
            to_bone = columns.reshape(len(bones), 4, 4).swapaxes(1, 2)
        sets = [n for n in range(_MOST_SETS) if f"JOINTS_{n}" in attributes]
    ends = np.cumsum([len(piece.vertices) for piece, _, _ in parts])
    rows = [slice(end - len(part[0].vertices), end) for end, part in zip(ends, parts, strict=True)]
    shapes = max(len(entry.get("targets", ())) for _, entry, _ in parts)
    check_decoded(file.name, (2, shapes, ends[-1], 3), 24)
    changes = np.zeros((2, shapes, ends[-1], 3))  # of vertices and of normals
    joints, weights = np.zeros((2, ends[-1], 4 * max(len(sets), 1)))
    for mine, (_, entry, values) in zip(rows, parts, strict=True):
        for n in sets:
            for kind, held in (("JOINTS", joints), ("WEIGHTS", weights)):
                if f"{kind}_{n}" in values:
                    held[mine, 4 * n : 4 * n + 4] = values[f"{kind}_{n}"]
        for shape, target in enumerate(entry.get("targets", ())):
            for row, name in enumerate(("POSITION", "NORMAL")):
                if name in target:
                    changes[row, shape, mine] = file.values(target[name])
    weights[:, 0] += weights.sum(axis=1) == 0  # by the first joint, or the node
    weights /= weights.sum(axis=1, keepdims=True)
    if joints.max(initial=0) >= len(bones):
        raise ValueError(f"node {number} has vertices of joints that are not there")
    stated = node.get("weights", mesh.get("weights", []))[:shapes]
    resting = animation.fixed([*stated, *[0.0] * (shapes - len(stated))])
    shares = nodes.shares.get(number) if shapes else None
    if shares and shares.values.shape[-1] != shapes:
        raise ValueError(f"the animation of node {number} has not one value for each shape")
    vertices = np.concatenate([piece.vertices for piece, _, _ in parts])
    skeletons = nodes.skeletons(bones, to_bone)
    at_rest = animation.Figure(
        skeletons[0], vertices, joints.astype(np.int64), weights, changes[0], changes[1], resting
    )
    every, now, motion = np.arange(len(vertices)), np.zeros(1), None
    placed = at_rest.places(every, now)
    if shares or len(skeletons) > 1:
        extent = float(np.ptp(placed, axis=0).max())
        if not extent > 0:
            raise ValueError(f"node {number} moves, but has no size at rest")
        # Vertices at one place, which may part, are distinguished by a small step.
        beside = np.asarray(cKDTree(placed).query(placed, k=2)[0])[:, 1] < 1e-9 * extent
        placed[beside, 0] += 1e-7 * extent * np.arange(1, beside.sum() + 1)
        figure = replace(at_rest, skeleton=skeletons[-1], shares=shares or resting)
        motion = animation.FigureMotion(figure, at_rest, placed, np.eye(4))
    turns = at_rest.change(at_rest.turns, every, now)
    maps, pieces = animation.inverse(at_rest.maps(every, now)[:, :3, :3]), []
    for mine, (piece, _, _) in zip(rows, parts, strict=True):
        normals = piece.normals
        if normals is not None:
            normals = np.einsum("nji,nj->ni", maps[mine], normals + turns[mine])
        pieces.append(replace(piece, vertices=placed[mine], normals=normals, motion=motion))
    return pieces


def _is_colored(header: Json, part: Json) -> bool:
    """True if a primitive has colors of its vertices, and no picture or shapes."""
    material = header["materials"][part["material"]] if "material" in part else {}
    has_colors = "COLOR_0" in part["attributes"] and part.get("mode", _TRIANGLES) >= _TRIANGLES
    return has_colors and not (gltf_surfaces.pictures_of(material) or part.get("targets"))


def _parts(file: GltfFile, number: int, looks: gltf_surfaces.Looks) -> Iterator[Part]:
    """Yield the piece of each part of a node's mesh with triangles, in its axes."""
    sets = [f"{kind}_{n}" for kind in ("JOINTS", "WEIGHTS") for n in range(_MOST_SETS)]
    node = file.header["nodes"][number]
    mesh = file.header["meshes"][node["mesh"]]
    name = str(node.get("name") or mesh.get("name") or f"node {number}")
    for part in mesh["primitives"]:
        if (mode := part.get("mode", _TRIANGLES)) not in range(_FAN + 1):
            raise ValueError(f"mesh of node {number} has mode {quoted(mode)}, which is none")
        if mode < _TRIANGLES:
            continue
        look = looks.of(part.get("material"))
        uv_name = f"TEXCOORD_{look.coordinates}"
        names = [
            "POSITION",
            "NORMAL",
            uv_name,
            *sets,
            *["COLOR_0"] * _is_colored(file.header, part),
        ]
        values = file.attributes(part, *names)
        corners = values.pop("indices", None)
        values = {attribute: of_it.astype(np.float64) for attribute, of_it in values.items()}
        if (vertices := values.get("POSITION")) is None:
            raise ValueError(f"object {quoted(name)!r} has no positions")
        indices = range(len(vertices)) if corners is None else corners[:, 0]
        is_list = gltf_file.DRACO in part.get("extensions", {})
        faces = _faces(np.asarray(indices, np.int64), _TRIANGLES if is_list else mode)
        uv = values.get(uv_name)
        if uv is not None:
            uv = uv @ look.to_picture[:2, :2].T + look.to_picture[:2, 2]
            uv[:, 1] = 1 - uv[:, 1]
        if "COLOR_0" in values:
            values = {attribute: of_it[faces.ravel()] for attribute, of_it in values.items()}
            picture, uv = _cells(values["COLOR_0"][:, :3])
            look = looks.of(part.get("material"), picture)
            vertices, faces = values["POSITION"], np.arange(len(uv)).reshape(-1, 3)
        piece = Piece(number, name, vertices, faces, look.paint, values.get("NORMAL"), uv)
        yield piece, part, values


def _cells(colors: Floats) -> tuple[NDArray[np.float32], Floats]:
    """Picture of colors (3F, 3) of the corners of triangles, and coordinates (3F, 2) in it.

    Every triangle has a cell of two by two pixels, between which colors are linear.
    """
    a, b, c = colors.reshape(-1, 3, 3).swapaxes(0, 1)
    side = math.ceil(math.sqrt(len(a)))
    cells = np.zeros((side**2, 2, 2, 3), np.float32)
    cells[: len(a)] = np.stack([a, b, c, b + c - a], axis=1).reshape(-1, 2, 2, 3).clip(0, 1)
    picture = cells.reshape(side, side, 2, 2, 3).swapaxes(1, 2).reshape(2 * side, 2 * side, 3)
    cell = np.arange(len(a))
    places = np.stack([cell % side, cell // side], axis=1)[:, np.newaxis] * 2.0 + 0.5
    uv = (places + np.array([[0, 0], [1, 0], [0, 1]])) / (2 * side)
    return picture, uv.reshape(-1, 2)


def _faces(corners: Ints, mode: int) -> Ints:
    """Triangles (F, 3) of vertex indices (n,), in a list, a strip or a fan."""
    if mode == _STRIP:
        strip = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
        strip[1::2] = strip[1::2, [1, 0, 2]]
        return strip
    if mode == _FAN:
        first = np.full(max(len(corners) - 2, 0), corners[0] if len(corners) else 0)
        return np.stack([first, corners[1:-1], corners[2:]], axis=1)
    return corners.reshape(-1, 3)
