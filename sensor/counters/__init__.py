"""What a counter makes of events."""
