"""What a SPAD adds and loses: one effect a file, with its parameters, its law and its sampler."""
