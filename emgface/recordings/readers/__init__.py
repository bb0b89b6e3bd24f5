"""Readers of recordings, one module per format.

A module with ``SUFFIXES`` (lower case, with the dot), ``FORMAT`` (a few words) and ``read(path,
units)`` is registered without further code. ``read`` returns a recording with the labels of the
file, in SI; ``units`` overrides the unit stated in the file for ``emg`` or ``position``, and
channels that are not read are listed, with reasons, in the attribute ``dropped``. It raises
DataError if the file is damaged, truncated or of another format, and UnitsError if a unit is
missing or of another quantity. Two functions are optional: ``is_recording(path)`` returns False for
a file with the suffix but other contents, and ``companions(path)`` returns further files of the
recording. Samples are
built with a time base (`emgface.recordings.timebase`), which compares all that the file says about
time. Modules whose names begin with an underscore are not readers.
"""
