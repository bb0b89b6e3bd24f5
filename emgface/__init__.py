"""emgface: experiments in which a person's sEMG drives a finite-element face."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("emgface")
except PackageNotFoundError:  # a source tree that was not installed
    __version__ = "0+unknown"
