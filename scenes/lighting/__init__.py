"""Light by name or in lux."""
