"""Motion detectors compared: rankings, scores, boards, thresholds of photons."""
