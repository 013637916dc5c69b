from .hashed_file import (
    HashedFile as HashedFile,
    PictureFile as PictureFile,
)
from .haze import Haze as Haze
from .material import (
    Emission as Emission,
    Material as Material,
    Texture as Texture,
)
from .motion import (
    Drift as Drift,
    Motion as Motion,
    ObjectMotion as ObjectMotion,
    RigidMotion as RigidMotion,
)
from .scene import (
    Asset as Asset,
    Environment as Environment,
    Lighting as Lighting,
    Placement as Placement,
    Scene as Scene,
    SkyPattern as SkyPattern,
    Sun as Sun,
    pattern_directions as pattern_directions,
)
