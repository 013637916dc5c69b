"""Chapter 2: SPADs, SPADCAM and its motion bench."""
