"""Declarations of datasets (`data_schema/`), checked at input and output of every stage."""
