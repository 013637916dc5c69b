"""Core utilities: files, bounded reading, progress, records, formats."""
