"""Sound of tubes such as the vocal tract: formants, waves in time, sources and wall pressure.

Arguments and results are arrays in SI units, independent of any face model. Waves are one-dimensional,
which is valid up to 4 to 5 kHz; side branches other than the nasal tract are absent.
"""

from emgface.acoustics.matrix import formants, lossless_formants, transfer
from emgface.acoustics.medium import CLOSURE_AREA, LOSSLESS, LineBranch, Medium
from emgface.acoustics.printed import TransferFunction, read_transfer_function
from emgface.acoustics.resonances import resonances
from emgface.acoustics.sources import NO_TURBULENCE, Flow, Folds, Source, Turbulence, rosenberg
from emgface.acoustics.wall_pressure import wall_pressure
from emgface.acoustics.waves import TubeSound, kelly_lochbaum, simulate_tube

__all__ = [
    "LOSSLESS",
    "NO_TURBULENCE",
    "CLOSURE_AREA",
    "LineBranch",
    "Flow",
    "Folds",
    "Medium",
    "Source",
    "TransferFunction",
    "TubeSound",
    "Turbulence",
    "formants",
    "kelly_lochbaum",
    "lossless_formants",
    "read_transfer_function",
    "resonances",
    "rosenberg",
    "simulate_tube",
    "transfer",
    "wall_pressure",
]
