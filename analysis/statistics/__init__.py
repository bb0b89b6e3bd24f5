"""Inference on a cube: what six volunteers can and cannot show."""
