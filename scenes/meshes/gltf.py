"""Nodes of a glTF 2.0 file (Khronos Group) as objects; errors of any kind mean a damaged file.

trimesh names parts at random, and rounds colors to eight bits.
"""

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import check_count, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes.animation import PARTS, Joint, NodeMotion, Track
from megalopta.scenes.meshes.gltf_file import (
    DRACO,
    EFFECTIVE,
    GltfFile,
    Json,
    image_of,
    parts_of,
    stands_in,
)
from megalopta.scenes.meshes.pieces import (
    MOST_OBJECTS,
    Paint,
    Piece,
    Unused,
    check_map,
    check_pictures,
    colored,
    linear_picture,
    weights_of,
)

_TRIANGLES, _STRIP, _FAN, _REPEAT = 4, 5, 6, 10497
_MOST_STEPS = 100_000
"""Most nodes on the ways from the scene's root to all moving meshes."""


def names_in(name: str, content: bytes) -> list[str]:
    """Names of the files with buffers and colors that a file names. Raises any exception."""
    if not name.lower().endswith((".glb", ".gltf")):
        return []
    header, _ = parts_of(content)
    models = (material.get("pbrMetallicRoughness", {}) for material in header.get("materials", ()))
    textures = (model["baseColorTexture"] for model in models if "baseColorTexture" in model)
    images = [header["images"][image_of(header, texture)] for texture in textures]
    buffers = [entry for entry in header.get("buffers", ()) if not stands_in(entry)]
    uris = [entry["uri"] for entry in [*buffers, *images] if "uri" in entry]
    return [unquote(uri) for uri in uris if not uri.startswith("data:")]


def stated(name: str, content: bytes) -> tuple[int, int, int]:
    """Vertices, triangles and primitives that the nodes place, of meshes as often as placed."""
    header, _ = parts_of(content)
    for things in ("nodes", "meshes", "materials", "textures", "images", "skins", "buffers"):
        check_count(name, things, len(header.get(things, ())), MOST_OBJECTS)
    counts = [int(accessor["count"]) for accessor in header.get("accessors", ())]
    placed = Counter(node["mesh"] for node in header.get("nodes", ()) if "mesh" in node)
    vertices = triangles = primitives = 0
    for number, times in placed.items():
        for part in header["meshes"][number]["primitives"]:
            position = part["attributes"]["POSITION"]
            corners = counts[part.get("indices", position)]
            is_list = part.get("mode", _TRIANGLES) == _TRIANGLES
            vertices += times * counts[position]
            triangles += times * (corners // 3 if is_list else corners)
            primitives += times
    return vertices, triangles, primitives


class _Look(NamedTuple):
    """Material, and how its picture lies on surfaces."""

    paint: Paint = Paint()
    coordinates: int = 0
    """Number of the set of coordinates."""
    to_picture: Floats = np.eye(3)
    """(3, 3): map of coordinates, with v downward."""


def pieces_of(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Piece]:
    """Yield the pieces of a file's nodes. Raises any exception if the file is damaged.

    If "animation" is used, they move as the file's first animation tells.
    """
    file, animated = GltfFile(contents), "animation" in used
    tracks = _tracks(file) if animated else {}
    nodes, to_world = file.header.get("nodes", []), _poses(file.header)
    above = {child: parent for parent in to_world for child in nodes[parent].get("children", ())}
    looks = _looks(file, next(iter(contents)))
    steps, is_moving = 0, False
    for number, pose in to_world.items():
        node = nodes[number]
        if "mesh" not in node:
            continue
        if "skin" in node:
            raise DamagedFileError(
                f"node {number} is a skinned figure, whose pose is not read; apply the pose to its "
                "mesh, and export it again"
            )
        chain = [number] if tracks else []  # from the node to the scene's root
        while chain and chain[-1] in above:
            chain.append(above[chain[-1]])
        chain.reverse()
        steps += len(chain)
        check_count(next(iter(contents)), "nodes above moving ones", steps, _MOST_STEPS)
        motion = _motion(nodes, chain, pose, tracks)
        for piece in _parts(file, number, looks):
            is_moving |= motion is not None
            yield replace(piece.moved(pose), motion=motion)
    if animated and not is_moving:
        raise DamagedFileError(
            "it has no animation of nodes with meshes, and morph weights do not move; omit animate"
        )


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect, if "animation" is used or not. Raises any exception."""
    header, _ = parts_of(next(iter(contents.values())))
    shown, playing = header.get("scene", 0), "animation" in used

    def named(kind: str, plural: str) -> list[tuple[str, Json]]:
        entries = enumerate(header.get(plural, ()))
        return [(str(entry.get("name") or f"{kind} {n}"), entry) for n, entry in entries]

    extensions = header.get("extensionsUsed", ())
    scenes, animations = named("scene", "scenes"), named("animation", "animations")
    yield from (("extensions", name) for name in extensions if name not in EFFECTIVE)
    yield from (("cameras", name) for name, _ in named("camera", "cameras"))
    yield from (("other scenes", name) for n, (name, _) in enumerate(scenes) if n != shown)
    yield from (("animations", name) for name, _ in animations[playing:])
    for name, material in named("material", "materials"):
        model = material.get("pbrMetallicRoughness", {})
        through = {"KHR_materials_transmission", "KHR_materials_volume"}
        through &= material.get("extensions", {}).keys()
        if through or material.get("alphaMode", "OPAQUE") != "OPAQUE":
            yield "transparency", name
        if model.get("metallicFactor", 1) > 0:  # 1 is glTF's own default
            yield "metal" + " in a picture" * ("metallicRoughnessTexture" in model), name
        if model.get("roughnessFactor", 1) < 1:
            yield "gloss", name
        if any(material.get("emissiveFactor", ())):
            yield "emission", name
        for kind in ("normal", "occlusion"):
            if f"{kind}Texture" in material:
                yield f"{kind} maps", name
    for name, mesh in named("mesh", "meshes"):
        for part in mesh["primitives"]:
            if part.get("mode", _TRIANGLES) < _TRIANGLES:
                yield "points and lines", name
            if "COLOR_0" in part["attributes"]:
                yield "colors of vertices", name
            if "targets" in part:
                yield "morph targets", name
    for sampler in header.get("samplers", ()):
        if {sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)} != {_REPEAT}:
            yield "pictures' clamping and mirroring", ""
    for _, animation in animations[:playing]:
        for target in (channel["target"] for channel in animation["channels"]):
            if target["path"] not in PARTS or "node" not in target:
                yield "an animation's morph weights, extensions", target["path"]


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
        poses[number] = above @ _local(nodes[number])
        check_map(
            poses[number], f"the place of node {number} ({quoted(nodes[number])})", may_flatten=True
        )
        waiting += [(child, poses[number]) for child in nodes[number].get("children", ())]
    return dict(sorted(poses.items()))


def _local(node: Json) -> Floats:
    if "matrix" in node:
        return np.reshape(node["matrix"], (4, 4)).astype(np.float64).T
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(node.get("rotation", [0, 0, 0, 1])).as_matrix()
    pose[:3, :3] *= np.asarray(node.get("scale", [1, 1, 1]), np.float64)
    pose[:3, 3] = node.get("translation", [0, 0, 0])
    return pose


def _tracks(file: GltfFile) -> dict[int, dict[str, Track]]:
    """Tracks of the first animation, by node and part of its pose."""
    tracks: dict[int, dict[str, Track]] = {}
    for animation in file.header.get("animations", ())[:1]:
        for channel in animation["channels"]:
            target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
            if target["path"] not in PARTS or "node" not in target:
                continue  # morph weights, and what an extension points at
            times = file.values(sampler["input"])[:, 0]
            values = file.values(sampler["output"]).astype(np.float64)
            mode = sampler.get("interpolation", "LINEAR")
            if mode == "CUBICSPLINE":
                values = values.reshape(len(times), 3, -1)
            tracks.setdefault(target["node"], {})[target["path"]] = Track(times, values, mode)
    return tracks


def _motion(
    nodes: Sequence[Json],
    chain: Sequence[int],
    pose: Floats,
    tracks: Mapping[int, Mapping[str, Track]],
) -> NodeMotion | None:
    """Motion of the last node of a chain; None if none of it moves."""
    if not any(node in tracks for node in chain):
        return None
    if np.linalg.det(pose[:3, :3]) == 0:
        raise ValueError(f"node {chain[-1]} moves, but has no size at rest")
    joints = (
        Joint(
            _local(nodes[each]),
            {part: nodes[each][part] for part in PARTS if part in nodes[each]},
            tracks.get(each, {}),
        )
        for each in chain
    )
    motion = NodeMotion(tuple(joints), pose, np.eye(4))
    keys = [track.times_s for node in chain for track in tracks.get(node, {}).values()]
    if not np.isfinite(motion.maps(np.unique(np.concatenate(keys)))).all():
        raise ValueError("its animation leads to places that are not finite")
    return motion


def _looks(file: GltfFile, owner: str) -> list[_Look]:
    """Look of each material; of a picture there is one copy for each color that multiplies it."""
    looks: list[_Look] = []
    pictures: dict[int, NDArray[np.float32]] = {}
    for number, material in enumerate(file.header.get("materials", ())):
        name = str(material.get("name") or f"material {number}")
        model = material.get("pbrMetallicRoughness", {})
        color = np.clip(model.get("baseColorFactor", [1, 1, 1])[:3], 0, 1)
        if (texture := model.get("baseColorTexture")) is None:
            looks.append(_Look(Paint(name, colored(color))))
            continue
        image = image_of(file.header, texture)
        if image not in pictures:
            pictures[image] = linear_picture(file.image(image), name)
        surface = colored(color, pictures[image])
        change = texture.get("extensions", {}).get("KHR_texture_transform", {})
        coordinates = int(change.get("texCoord", texture.get("texCoord", 0)))
        turn, to_picture = change.get("rotation", 0.0), np.eye(3)
        to_picture[:2, :2] = [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        to_picture[:2, :2] *= np.asarray(change.get("scale", [1, 1]), np.float64)
        to_picture[:2, 2] = change.get("offset", [0, 0])
        looks.append(_Look(Paint(name, surface), coordinates, to_picture))
        check_pictures(owner, weights_of(look.paint.material for look in looks))
    return looks


def _parts(file: GltfFile, number: int, looks: Sequence[_Look]) -> Iterator[Piece]:
    """Yield the piece of each part of a node's mesh with triangles, in its axes."""
    node = file.header["nodes"][number]
    mesh = file.header["meshes"][node["mesh"]]
    name = str(node.get("name") or mesh.get("name") or f"node {number}")
    for part in mesh["primitives"]:
        if (mode := part.get("mode", _TRIANGLES)) not in range(_FAN + 1):
            raise ValueError(f"mesh of node {number} has mode {quoted(mode)}, which is none")
        if mode < _TRIANGLES:
            continue
        look = looks[part["material"]] if "material" in part else _Look()
        packed = part.get("extensions", {})
        values = file.attributes(part, "POSITION", "NORMAL", f"TEXCOORD_{look.coordinates}")
        corners = values.pop("indices", None)
        values = {attribute: found.astype(np.float64) for attribute, found in values.items()}
        if (vertices := values.get("POSITION")) is None:
            raise ValueError(f"object {quoted(name)!r} has no positions")
        indices = range(len(vertices)) if corners is None else corners[:, 0]
        faces = _faces(np.asarray(indices, np.int64), _TRIANGLES if DRACO in packed else mode)
        uv = values.get(f"TEXCOORD_{look.coordinates}")
        if uv is not None:
            uv = uv @ look.to_picture[:2, :2].T + look.to_picture[:2, 2]
            uv[:, 1] = 1 - uv[:, 1]
        yield Piece(number, name, vertices, faces, look.paint, values.get("NORMAL"), uv)


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
