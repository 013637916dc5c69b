"""What stands where, what lights it and how the camera moves, as plain frozen data.

    light, camera, trajectory = Light(level="starlight"), PerspectiveCamera(), Trajectory()
    scene = build_scene(Forest(trees=200), light, camera, trajectory)

World coordinates are right-handed meters with z up. Nothing here knows a renderer.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
