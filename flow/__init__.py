"""Photon counts to motion: detectors, error metrics and the photon benchmark, on plain arrays.

Conventions, the same in every file of this folder:

- A sequence is an array (T, H, W): frame, row, column. Row 0 is the top of the image, column 0 its
  left edge.
- A velocity or a flow is an array (..., 2): first x, positive to the right (growing column), then
  y, positive downward (growing row), in pixels of the given frames, per frame. Content that moves
  from column 10 to column 13 has velocity (+3, 0).
- Flow t leads from frame t to frame t + 1, so T frames have T − 1 flows.
- NaN is an undefined value: the flow of the sky, the velocity of a block without texture, a
  correlation detector at the edge of the image. It never means zero.
- A directional correlation detector responds positively to motion toward +x.
- A flux is the mean number of photons per frame, summed over all pixels, without dark counts.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
