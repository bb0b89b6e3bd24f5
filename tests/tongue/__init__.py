"""Tests of the tongue."""
