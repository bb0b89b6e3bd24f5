"""Pages that answer: a server on this computer, the live face, curves, and recordings to browse."""
