"""The camera's own motion from a whole field of responses."""
