"""Activations of the face from measured lip motion, with and without sEMG."""
