"""Functions of ``import emgface as ef``, one for every stage.

Arguments have the names of the command line's options; tables of parameters have the names of the
study file (``emgface study template``). Files and datasets are both accepted. Other modules are
imported in the functions, so that importing this module is fast.
"""

from emgface.api.checks import check
from emgface.api.faces import face, reduce, simulate
from emgface.api.fits import fit
from emgface.api.inversions import invert
from emgface.api.models import build
from emgface.api.recordings import activate, describe, read, score
from emgface.api.sounds import sound
from emgface.api.studies import report, study
from emgface.api.treatments import compare, treat
from emgface.api.views import show

__all__ = [
    "activate",
    "build",
    "check",
    "compare",
    "describe",
    "face",
    "fit",
    "invert",
    "read",
    "reduce",
    "report",
    "score",
    "show",
    "simulate",
    "sound",
    "study",
    "treat",
]
