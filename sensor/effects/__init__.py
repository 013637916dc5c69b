"""Effects of a SPAD, one per file: parameters, count distribution and sampler."""
