"""Simulated volunteers: known activations, synthesised sEMG, marker tracks of a face model.

Nothing here was measured: all files made from it carry ``origin = "simulated"``.
"""
