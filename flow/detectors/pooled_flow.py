"""Poisson flow of up to eight frames of one velocity (PPF).

All pairs of the frames count at once: aligned by a flow, their roots differ from their mean by
noise, and the sum of these squares is, up to a factor, that over all pairs. The flow is that of the
middle of the frames, under the assumption that nothing has accelerated between the oldest and the
newest; at the start of a sequence there are fewer frames.
"""

from typing import ClassVar

from megalopta.flow.detectors.poisson_flow import PoissonFlow
from megalopta.flow.detectors.pooled_frames import PooledFrames


class PooledFlow(PooledFrames, PoissonFlow, frozen=True):
    """Dense flow by the likelihood of counts in several frames, averaged over blocks."""

    place: ClassVar[float] = 15

    name: str = "PPF"
    """Short name"""

    label: str = "Pooled Poisson flow"
    """Name in words"""
