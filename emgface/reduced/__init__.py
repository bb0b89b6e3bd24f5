"""Reduced faces: training, file, and motions with an estimated error."""
