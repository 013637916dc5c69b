"""All methods side by side, beyond the dissertation."""
