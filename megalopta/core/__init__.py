"""What all packages stand on: files, bounded reading, progress, records, formats."""
