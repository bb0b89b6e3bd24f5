"""Readers of recordings, one module per format.

A module here with ``SUFFIXES`` (lower case, with the dot), ``FORMAT`` (a few words),
``is_recording(path)`` (False for a file of that suffix that is plainly something else) and
``read(path, units)`` is found by itself: adding a format is adding a file. ``read`` returns a
recording under the labels of the file, in SI; ``units`` overrides the unit that the file names for
``emg`` or ``position``. ``companions(path)``, where a module has it, returns the further files that a
recording consists of. Modules whose name begins with an underscore are no readers.
"""
