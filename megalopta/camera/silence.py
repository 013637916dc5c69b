"""A camera that is plugged in and sends no frames: when to give up, and what came instead."""

from megalopta.camera.link import Link

PATIENCE_S = 8.0
"""Beyond three periods of the frame rate; what is no camera does not fill the disk for longer."""


class Silence:
    """Time that a camera was plugged in since the last new frame.

    Parameters
    ----------
    link : Link
    period_s : float
        Of its frames, s.
    """

    def __init__(self, link: Link, period_s: float) -> None:
        self._link, self._limit_s = link, PATIENCE_S + 3 * period_s
        self._waited_s = 0.0
        self._frames = self._packets = self._bytes = self._damaged = 0

    def noted(self, packets: int) -> None:
        """Say from now on what comes instead of frames, after so many packets."""
        self._packets = packets
        self._bytes, self._damaged = self._link.decoded_bytes, self._link.damaged

    def waited(self, seconds: float, frames: int, packets: int) -> None:
        """Note a time that was waited, and how many new frames and packets there are so far.

        Raises
        ------
        UserError
            When no new frame came for too long.
        """
        if frames != self._frames:
            self._waited_s, self._frames = 0.0, frames
            self.noted(packets)
        self._waited_s += seconds
        if self._waited_s > self._limit_s:
            came = self._came(packets)
            raise self._link.given_up(f"no new frame in {self._limit_s:.1f} s, {came} instead")

    def _came(self, packets: int) -> str:
        came = self._link.decoded_bytes - self._bytes
        if not came:
            return "nothing came"
        damaged, whole = self._link.damaged - self._damaged, packets - self._packets
        return f"{came} bytes with {damaged} damaged and {whole} whole packets came"
