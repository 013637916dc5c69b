from .film import Film as Film
from .primary import (
    developed as developed,
    means_of_pixels as means_of_pixels,
    pixel_means as pixel_means,
)
