from .hashed_file import HashedFile as HashedFile
from .motion import (
    Drift as Drift,
    Motion as Motion,
    ObjectMotion as ObjectMotion,
    RigidMotion as RigidMotion,
)
from .scene import (
    Asset as Asset,
    Emission as Emission,
    Environment as Environment,
    Lighting as Lighting,
    Material as Material,
    Placement as Placement,
    Scene as Scene,
    Sun as Sun,
    Texture as Texture,
)
