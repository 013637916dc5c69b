"""Scene data to spectral radiance and exact ground truth; the only folder that imports mitsuba."""
