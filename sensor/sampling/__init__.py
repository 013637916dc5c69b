"""Random streams with names, and fast draws from them."""
