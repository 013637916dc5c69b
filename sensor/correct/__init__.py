"""From raw readings back to detections: what every laboratory does before it looks at frames."""
