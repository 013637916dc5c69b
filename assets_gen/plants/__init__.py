"""Trees, undergrowth and fallen wood, grown from a seed."""
