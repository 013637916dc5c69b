"""Motion detectors and estimators."""
