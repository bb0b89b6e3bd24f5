"""Measurements of the package itself: error, run time, stability, calibration, recovery.

``python -m benchmarks`` lists them, ``python -m benchmarks NAME --help`` gives the options of one. A
measurement is a module with a function ``main``, whose parameters are its options; most end in one
table, which `benchmarks.report.finish` prints in Markdown and stores with a figure.
"""
