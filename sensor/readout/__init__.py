"""Products of a sensor: frames, binary frames, event streams, and their store on disk."""
