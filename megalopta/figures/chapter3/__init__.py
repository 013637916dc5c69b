"""Chapter 3: the adaptive CTIA pixel."""
