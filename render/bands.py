"""Spectral bands and the names of their EXR channels."""

from collections.abc import Sequence

Bands = Sequence[tuple[float, float]]


def channel_names(bands_nm: Bands) -> list[str]:
    """Name of the channel of each band, after its center, which must be its own (ValueError)."""
    names = [_channel_name(band) for band in bands_nm]
    for name in names:
        if names.count(name) > 1:
            first, second, *_ = (
                f"{lower:g}-{upper:g}"
                for (lower, upper), other in zip(bands_nm, names, strict=True)
                if other == name
            )
            raise ValueError(
                f"bands_nm: {first} and {second} nm share a center, which names the channel "
                f"{name}; move an edge of one"
            )
    return names


def _channel_name(band: tuple[float, float]) -> str:
    return f"S0.{(band[0] + band[1]) / 2:.3f}nm".replace(".", ",").replace("S0,", "S0.")
