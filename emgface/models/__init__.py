"""Models of face, jaw, tongue and head as kinds with one contract."""
