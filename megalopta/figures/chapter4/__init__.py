"""Chapter 4: the flow benchmark."""
