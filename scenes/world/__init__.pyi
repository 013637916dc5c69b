from .hashed_file import HashedFile
from .motion import Drift, Motion, ObjectMotion, RigidMotion
from .scene import Asset, Emission, Environment, Lighting, Material, Placement, Scene, Sun, Texture

__all__ = [
    "Asset",
    "Drift",
    "Emission",
    "Environment",
    "HashedFile",
    "Lighting",
    "Material",
    "Motion",
    "ObjectMotion",
    "Placement",
    "RigidMotion",
    "Scene",
    "Sun",
    "Texture",
]
