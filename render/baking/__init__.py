"""Light on surfaces, computed once and looked up by every frame."""
