"""What SPADCAM and its host say to each other: docs/spadcam-protocol.md."""
