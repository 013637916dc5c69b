"""Files of frames, bits and events, in the formats of cameras and other programs."""
