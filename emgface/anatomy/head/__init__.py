"""Heads: faces, jaws, tongues and hyoids coupled in one scene."""
