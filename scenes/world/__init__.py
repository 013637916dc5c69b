"""What every scene consists of: placements, materials, emitters, motion."""
