"""Which mesh of a loaded scene was hit, in every vectorized variant.

Embree numbers the shapes of a scene, OptiX does not; what both give is the shape itself, as its
number in Dr.Jit's registry of all shapes of the process.
"""

from typing import Any

import numpy as np

from megalopta.render import dr, mi


class MeshIndex:
    """The meshes of a loaded scene by their shape; the active variant must be a vectorized one."""

    def __init__(self, loaded: Any) -> None:
        registered = np.array(dr.reinterpret_array(mi.UInt, loaded.shapes_dr()))
        # Entry 0 is what a ray has hit that hit nothing.
        table = np.zeros(1 + int(registered.max(initial=0)), np.uint32)
        table[registered] = np.arange(len(registered))
        self._table = mi.UInt(table)

    def of(self, hit: Any) -> Any:
        """Index of the mesh, as loaded, of each preliminary intersection (N,); 0 of a miss."""
        shape: Any = dr.reinterpret_array(mi.UInt, hit.shape)
        return dr.gather(mi.UInt, self._table, shape)
