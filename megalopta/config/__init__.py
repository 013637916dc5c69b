"""What is asked for: configurations of a sequence, recipes of datasets, YAML."""
