"""Settings of the verbs, as the command line and its help show them."""
