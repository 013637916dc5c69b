"""A forest's floor, kept for whoever builds the same again.

It depends on the seed, on where the path runs and the trees stand, and on few of the forest's
fields, not on light, camera or what grows.
"""

from typing import TYPE_CHECKING

import numpy as np

from megalopta.assets_gen import FloatArray
from megalopta.assets_gen.terrain import Terrain
from megalopta.assets_gen.trail import Trail
from megalopta.assets_gen.triangulation import Triangulation
from megalopta.core.freshness import digest
from megalopta.scenes.forest.floor import Floor, make_floor
from megalopta.scenes.forest.nursery import store_of

if TYPE_CHECKING:
    from megalopta.scenes.forest.description import Forest

FIELDS = {
    "seed",
    "detail",
    "ground",
    "relief_m",
    "floor_relief_m",
    "moss_share",
    "path_width_m",
}
"""Of the forest, that its floor depends on."""
_COVER = "cover "


def kept_floor(
    forest: "Forest", land: Terrain, trail: Trail | None, trees: FloatArray, edge_m: float
) -> Floor:
    """Return the floor that `make_floor` makes, made only once."""
    places = [land.path.data, trees] + ([trail.line.data] if trail else [])
    fields = forest.model_dump_json(include=FIELDS)
    store = store_of("floor", fields, str(edge_m), digest(*(each.tobytes() for each in places)))
    if kept := store.read():
        covers = {
            name.removeprefix(_COVER): chosen
            for name, chosen in kept.items()
            if name.startswith(_COVER)
        }
        mesh = Triangulation(kept["points"], kept["faces"].astype(np.int64))
        return Floor(mesh, kept["heights"], kept["uv"], covers, kept["leaves"])
    floor = make_floor(forest, land, trail, trees, edge_m)
    store.write(
        {
            "points": floor.mesh.points,
            "faces": floor.mesh.faces.astype(np.int32),
            "heights": floor.heights,
            "uv": floor.uv,
            "leaves": floor.leaves,
            **{f"{_COVER}{name}": chosen for name, chosen in floor.covers.items()},
        }
    )
    return floor
