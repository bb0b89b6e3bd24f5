"""Declarations of datasets (`data_schema/`), checked on input and output of every stage."""
