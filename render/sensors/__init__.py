"""What turns a loaded scene into pixels: films, passes and cameras of our own."""
