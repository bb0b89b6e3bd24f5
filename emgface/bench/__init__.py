"""Measurements of the package itself: error against run time, stability, cost, growth.

Each module makes one labelled Dataset; `emgface bench` stores it as netCDF, as a table (CSV) and as a
figure.
"""
