"""Datasets in the Brain Imaging Data Structure, version 1.11: EMG-BIDS and Motion-BIDS.

Names of files, tables of the signals, rules for datasets, and the writer. The
signals themselves are read by `emgface.recordings.readers`.
"""

from emgface.recordings.bids.rules import bids_problems
from emgface.recordings.bids.write import write_bids

__all__ = ["bids_problems", "write_bids"]
