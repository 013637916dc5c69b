"""Camera motion from a whole field of responses."""
