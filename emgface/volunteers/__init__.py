"""Simulated volunteers: known activations, synthesised sEMG, marker tracks of a face model.

No data of this package are measured; all files carry ``origin = "simulated"``.
"""
