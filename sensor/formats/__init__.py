"""Files of frames, bits and events, as cameras and other programs write them."""
