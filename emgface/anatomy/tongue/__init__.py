"""Tongue: elements with muscle fibres, attached to jaw and hyoid."""
