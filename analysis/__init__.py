"""Comparison of measured and simulated trajectories: alignment, scores, cubes."""
