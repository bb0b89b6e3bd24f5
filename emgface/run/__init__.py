"""Execution of tasks by workers, and the store and journal of their results."""
