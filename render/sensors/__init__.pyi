from .film import Film as Film
