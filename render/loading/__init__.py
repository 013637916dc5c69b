"""Scene data to Mitsuba scenes."""
