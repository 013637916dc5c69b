"""Light on surfaces, computed once and looked up in every frame."""
