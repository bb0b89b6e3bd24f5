"""Jaw, hyoid and larynx: rigid bodies, line muscles and joints, as of a file; their tasks and motion."""
