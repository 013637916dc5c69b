"""Two recordings of one stimulus: whether they differ, by how much, and in what."""
