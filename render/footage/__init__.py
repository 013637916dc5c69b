"""Your pictures, videos and arrays as frames of linear light.

with open_footage(Path("clip.mp4")) as footage:
    light = footage.frame(0)  # (H, W, 3), 1 is the white of the code
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
