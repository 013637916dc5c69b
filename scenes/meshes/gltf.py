"""Nodes of a glTF 2.0 file (Khronos Group) as objects; errors of any kind mean a damaged file.

trimesh names parts at random, and rounds colors to eight bits.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from megalopta.core.arrays import Floats, Ints
from megalopta.core.bounded import check_count, check_decoded, quoted
from megalopta.core.errors import DamagedFileError
from megalopta.scenes.meshes import gltf_surfaces
from megalopta.scenes.meshes.animation import (
    PARTS,
    FigureMotion,
    Joint,
    NodeMotion,
    Skeleton,
    Track,
    inverse,
)
from megalopta.scenes.meshes.gltf_file import (
    DRACO,
    EFFECTIVE,
    GltfFile,
    Json,
    extension,
    image_of,
    parts_of,
    stands_in,
)
from megalopta.scenes.meshes.gltf_surfaces import Look, light_of, looks_of, pictures_of, unused_of
from megalopta.scenes.meshes.pieces import MOST_OBJECTS, Piece, Unused, check_map
from megalopta.scenes.scene import Lamp

LIGHTS = "KHR_lights_punctual"
_TRIANGLES, _STRIP, _FAN, _REPEAT = 4, 5, 6, 10497
_SHARES, _MOST_SETS, _MOST_BONES = "weights", 4, 1000
_POSE_BYTES = 400
"""Memory of the pose of a joint at a time, with its copies."""
_MOST_STEPS = 100_000
"""Most nodes on the ways from the scene's root to all moving meshes."""


Tracks = dict[int, dict[str, Track]]
"""Tracks by node, and by part of its pose or "weights"."""
Part = tuple[Piece, Json, Mapping[str, NDArray[Any]]]
"""Piece of a primitive, and its entry and attributes."""


def names_in(name: str, content: bytes) -> list[str]:
    """Names of the files with buffers and colors that a file names. Raises any exception."""
    if not name.lower().endswith((".glb", ".gltf")):
        return []
    header, _ = parts_of(content)
    materials = header.get("materials", ())
    textures = (entry for material in materials for entry in pictures_of(material).values())
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
            sets = sum(attribute.startswith("JOINTS_") for attribute in part["attributes"])
            copies = 1 + sets + 2 * len(part.get("targets", ()))
            vertices += times * counts[position] * copies
            triangles += times * (corners // 3 if is_list else corners)
            primitives += times
    return vertices, triangles, primitives


def pieces_of(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Piece]:
    """Yield the pieces of a file's nodes. Raises any exception if the file is damaged.

    If "animation" is used, they move as the file's first animation tells.
    """
    file, animated = GltfFile(contents), "animation" in used
    tracks = _tracks(file) if animated else {}
    nodes, to_world = file.header.get("nodes", []), _poses(file.header)
    above = {child: parent for parent in to_world for child in nodes[parent].get("children", ())}
    looks = list(looks_of(file, "lights" in used))
    steps, is_moving = 0, False
    for number, pose in to_world.items():
        node = nodes[number]
        if "mesh" not in node:
            continue
        parts = list(_parts(file, number, looks))
        if "skin" in node or any(part.get("targets") for _, part, _ in parts):
            pieces = _figure(file, number, parts, above, tracks)
        else:
            chain = _chain(number, above) if tracks else []
            steps += len(chain)
            check_count(file.name, "nodes above moving ones", steps, _MOST_STEPS)
            motion = _motion(nodes, chain, pose, tracks)
            pieces = [replace(piece.moved(pose), motion=motion) for piece, _, _ in parts]
        is_moving |= any(piece.motion for piece in pieces)
        yield from pieces
    if animated and not is_moving:
        raise DamagedFileError("it has no animation of nodes with meshes; omit animate")


def unused(contents: Mapping[str, bytes], used: Collection[str] = ()) -> Iterator[Unused]:
    """Yield what has no effect, if "animation" is used or not. Raises any exception."""
    header, _ = parts_of(next(iter(contents.values())))
    shown, playing, shines = header.get("scene", 0), "animation" in used, "lights" in used

    def named(kind: str, plural: str) -> list[tuple[str, Json]]:
        entries = enumerate(header.get(plural, ()))
        return [(str(entry.get("name") or f"{kind} {n}"), entry) for n, entry in entries]

    effective = *EFFECTIVE, *gltf_surfaces.EFFECTIVE, *[LIGHTS] * shines
    extensions = [name for name in header.get("extensionsUsed", ()) if name not in effective]
    scenes, animations = named("scene", "scenes"), named("animation", "animations")
    yield from (("extensions", name) for name in extensions)
    yield from (("cameras", name) for name, _ in named("camera", "cameras"))
    yield from (("other scenes", name) for n, (name, _) in enumerate(scenes) if n != shown)
    yield from (("animations", name) for name, _ in animations[playing:])
    for name, material in named("material", "materials"):
        yield from ((feature, name) for feature in unused_of(material, shines))
    for name, mesh in named("mesh", "meshes"):
        for part in mesh["primitives"]:
            if part.get("mode", _TRIANGLES) < _TRIANGLES:
                yield "points and lines", name
            if "COLOR_0" in part["attributes"]:
                yield "colors of vertices", name
    for sampler in header.get("samplers", ()):
        if {sampler.get("wrapS", _REPEAT), sampler.get("wrapT", _REPEAT)} != {_REPEAT}:
            yield "pictures' clamping and mirroring", ""
    for lamp in extension(header, LIGHTS).get("lights", ()) if shines else ():
        if "range" in lamp:
            yield "ranges of lamps", str(lamp.get("name", ""))
    for _, animation in animations[:playing]:
        for target in (channel["target"] for channel in animation["channels"]):
            if target["path"] not in (*PARTS, _SHARES) or "node" not in target:
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
            shining = light_of(color, float(lamp.get("intensity", 1.0)))
            lamps.append(Lamp(kind, shining, pose, tuple(np.degrees(angles).tolist())))
    return lamps


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


def _tracks(file: GltfFile) -> Tracks:
    """Tracks of the first animation, by node and part of its pose, or shares of its shapes."""
    tracks: dict[int, dict[str, Track]] = {}
    for animation in file.header.get("animations", ())[:1]:
        for channel in animation["channels"]:
            target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
            if target["path"] not in (*PARTS, _SHARES) or "node" not in target:
                continue  # what an extension points at
            times = file.values(sampler["input"])[:, 0]
            values = file.values(sampler["output"]).astype(np.float64)
            mode = sampler.get("interpolation", "LINEAR")
            if mode == "CUBICSPLINE":
                values = values.reshape(len(times), 3, -1)
            elif target["path"] == _SHARES:
                values = values.reshape(len(times), -1)
            tracks.setdefault(target["node"], {})[target["path"]] = Track(times, values, mode)
    return tracks


def _motion(
    nodes: Sequence[Json], chain: Sequence[int], pose: Floats, tracks: Tracks
) -> NodeMotion | None:
    """Motion of the last node of a chain; None if none of it moves."""
    if not any(tracks.get(node, {}).keys() - {_SHARES} for node in chain):
        return None
    if np.linalg.det(pose[:3, :3]) == 0:
        raise ValueError(f"node {chain[-1]} moves, but has no size at rest")
    joints = tuple(_joint(nodes[node], tracks.get(node, {})) for node in chain)
    motion = NodeMotion(joints, pose, np.eye(4))
    if not np.isfinite(motion.maps(_keys(joints))).all():
        raise ValueError("its animation leads to places that are not finite")
    return motion


def _chain(node: int, above: Mapping[int, int]) -> list[int]:
    """Nodes from the scene's root to a node."""
    chain = [node]
    while chain[-1] in above:
        chain.append(above[chain[-1]])
    return chain[::-1]


def _joint(node: Json, tracks: Mapping[str, Track]) -> Joint:
    parts = {part: node[part] for part in PARTS if part in node}
    of_pose = {part: track for part, track in tracks.items() if part in PARTS}
    return Joint(_local(node), parts, of_pose)


def _keys(joints: Sequence[Joint]) -> Floats:
    """Times (n,) of all keys of some joints."""
    keys = [track.times_s for joint in joints for track in joint.tracks.values()]
    return np.unique(np.concatenate([np.zeros(1), *keys]))


def _figure(
    file: GltfFile,
    number: int,
    parts: Sequence[Part],
    above: Mapping[int, int],
    tracks: Tracks,
) -> list[Piece]:
    """Pieces of a skinned or morphed node, as its file poses it, with the motion of all."""
    nodes = file.header["nodes"]
    node, mesh = nodes[number], file.header["meshes"][nodes[number]["mesh"]]
    bones, to_bone = [number], np.eye(4)[np.newaxis]
    if "skin" in node:
        skin = file.header["skins"][node["skin"]]
        bones = skin["joints"]
        check_count(file.name, "joints of a skin", len(bones), _MOST_BONES)
        to_bone = np.tile(np.eye(4), (len(bones), 1, 1))
        if "inverseBindMatrices" in skin:
            columns = file.values(skin["inverseBindMatrices"])[: len(bones)]
            to_bone = columns.reshape(len(bones), 4, 4).swapaxes(1, 2)
    order = list(dict.fromkeys(step for bone in bones for step in _chain(bone, above)))
    place = {step: at for at, step in enumerate(order)}
    joints = tuple(_joint(nodes[step], tracks.get(step, {})) for step in order)
    parents = tuple(place[above[step]] if step in above else -1 for step in order)
    skeleton = Skeleton(joints, parents, np.array([place[bone] for bone in bones]), to_bone)
    held = [_held(values, len(piece.vertices), "skin" in node) for piece, _, values in parts]
    bone_of, weight = (np.concatenate(columns) for columns in zip(*held, strict=True))
    if bone_of.max(initial=0) >= len(bones):
        raise ValueError(f"node {number} has vertices of joints that are not there")
    targets, turns = (_shapes(file, parts, name) for name in ("POSITION", "NORMAL"))
    shares = np.zeros(len(targets))
    stated = node.get("weights", mesh.get("weights", []))[: len(shares)]
    shares[: len(stated)] = stated
    track = tracks.get(number, {}).get(_SHARES) if len(shares) else None
    if track and track.values.shape[-1] != len(shares):
        raise ValueError(f"the animation of node {number} has not one value for each shape")
    vertices = np.concatenate([piece.vertices for piece, _, _ in parts])
    still = FigureMotion(
        skeleton, vertices, vertices, bone_of, weight, targets, turns, shares, track, np.eye(4)
    )
    placed, keys = still.at_rest(), _keys(joints)
    check_decoded(file.name, (len(keys), len(order) + len(bones)), _POSE_BYTES)
    if not (np.isfinite(skeleton.maps(keys)).all() and np.isfinite(placed).all()):
        raise ValueError("its animation leads to places that are not finite")
    motion = None
    if still.is_moving:
        extent = float(np.ptp(placed, axis=0).max())
        if not extent:
            raise ValueError(f"node {number} moves, but has no size at rest")
        # Vertices at one place, which may part, are told from each other by a small step.
        beside = np.asarray(cKDTree(placed).query(placed, k=2)[0])[:, 1] < 1e-9 * extent
        placed[beside, 0] += 1e-7 * extent * np.arange(1, beside.sum() + 1)
        motion = replace(still, placed=placed)
    ends = np.cumsum([len(piece.vertices) for piece, _, _ in parts])[:-1]
    linear = still.rest_maps()[:, :3, :3]
    pieces = []
    for (piece, _, _), where in zip(parts, np.split(np.arange(len(placed)), ends), strict=True):
        normals = piece.normals
        if normals is not None:
            normals = normals + np.einsum("k,knj->nj", shares, turns[:, where])
            normals = np.einsum("nji,nj->ni", inverse(linear[where]), normals)
        pieces.append(replace(piece, vertices=placed[where], normals=normals, motion=motion))
    return pieces


def _held(values: Mapping[str, NDArray[Any]], count: int, is_skin: bool) -> tuple[Ints, Floats]:
    """Bones (V, k) that hold vertices, and their weights (V, k), which add up to 1."""
    if not is_skin:
        return np.zeros((count, 1), np.int64), np.ones((count, 1))
    sets = [n for n in range(_MOST_SETS) if f"JOINTS_{n}" in values]
    joints = np.concatenate([values[f"JOINTS_{n}"] for n in sets], axis=1).astype(np.int64)
    weights = np.concatenate([values[f"WEIGHTS_{n}"] for n in sets], axis=1).astype(np.float64)
    sums = weights.sum(axis=1, keepdims=True)
    first = np.eye(1, weights.shape[1])
    return joints, np.where(sums > 0, weights / np.where(sums > 0, sums, 1), first)


def _shapes(file: GltfFile, parts: Sequence[Part], name: str) -> Floats:
    """Displacements (K, V, 3) of the shapes of all parts."""
    count = max(len(part.get("targets", ())) for _, part, _ in parts)
    vertices = sum(len(piece.vertices) for piece, _, _ in parts)
    check_decoded(file.name, (count, vertices, 3), 24)
    shapes, start = np.zeros((count, vertices, 3)), 0
    for piece, part, _ in parts:
        end = start + len(piece.vertices)
        for shape, target in enumerate(part.get("targets", ())):
            if name in target:
                shapes[shape, start:end] = file.values(target[name])
        start = end
    return shapes


def _parts(file: GltfFile, number: int, looks: Sequence[Look]) -> Iterator[Part]:
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
        look = looks[part["material"]] if "material" in part else Look()
        packed = part.get("extensions", {})
        values = file.attributes(part, "POSITION", "NORMAL", f"TEXCOORD_{look.coordinates}", *sets)
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
        piece = Piece(number, name, vertices, faces, look.paint, values.get("NORMAL"), uv)
        yield piece, part, values


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
