"""Files of landmarks and surfaces, read without trust in their content."""
