"""What somebody else adds to megalopta."""
