from .film import Film as Film
from .primary import pixel_means as pixel_means
