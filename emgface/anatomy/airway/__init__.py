"""Airway: area functions of tables, surfaces and lips, and their formants and sound."""
