"""Measurements of the package itself: error, run time, stability, calibration, recovery.

``python -m benchmarks`` lists them, ``python -m benchmarks NAME --help`` lists the options of one.
A measurement is a module with a function ``main``, whose parameters are its options; most print one
table in Markdown and store it with a figure (`benchmarks.report.finish`).
"""
