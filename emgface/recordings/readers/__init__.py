"""Readers of recordings, one module per format.

A module here with ``SUFFIXES`` (lower case, with the dot), ``FORMAT`` (a few words) and
``read(path, units)`` is registered without further code. ``read`` returns a recording under the
labels of the file, in SI; ``units`` overrides the unit that the file states for ``emg`` or
``position``. Two functions are optional: ``is_recording(path)`` returns False for a file of the
suffix that is evidently something else, and ``companions(path)`` returns the further files of which
a recording consists. Modules whose names begin with an underscore are not readers.
"""
