"""Named random streams, and fast draws from them."""
