"""Area functions for tests, including published ones if their files are available."""

import csv
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

TABLE = {
    "a": ((653, 1118, 2483, 3650), (644, 1047, 2411, 3484)),
    "o": ((511, 887, 2383, 3432), (511, 836, 2353, 3425)),
    "u": ((231, 593, 2362, 3678), (271, 605, 2370, 3682)),
    "i_barred": ((284, 1611, 2329, 3362), (314, 1430, 2317, 3333)),
    "i": ((226, 2260, 3152, 3723), (267, 2254, 2853, 3644)),
    "e": ((425, 1982, 2847, 3726), (435, 1933, 2706, 3341)),
    "neutral": ((500, 1500, 2500, 3500), (499, 1427, 2378, 3340)),
    "0": ((230, 2498, 3595, 4069), (295, 2501, 3188, 3939)),
    "2": ((660, 2122, 2761, 3610), (660, 2023, 2610, 3570)),
    "5": ((807, 1210, 2881, 3449), (814, 1143, 2784, 3440)),
    "7": ((382, 878, 2514, 3786), (411, 871, 2525, 3794)),
    "9": ((264, 1219, 2456, 3724), (318, 1143, 2465, 3731)),
}
"""F1 to F4 [Hz] of the specification: lossless, and with losses (orientation, about 2 %)."""


def tubes(shared: Path) -> dict[str, tuple[Floats, float]]:
    """Areas from the glottis to the lips [m^2] and length [m], by vowel or index."""
    folder = shared / "artisynth_models" / "airway" / "tubesounds"
    found: dict[str, tuple[Floats, float]] = {}
    with (folder / "derived_vowel_areas_lips_to_glottis.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            areas = [float(v) for v in row["areas_cm2_from_lips_space_separated"].split()]
            found[row["vowel"]] = np.array(areas[::-1]) * 1e-4, 0.005 * len(areas)
    with (folder / "derived_area_functions.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            areas = [float(row[f"A{k}_cm2"]) for k in range(40)]
            found[row["index"]] = np.array(areas) * 1e-4, float(row["length_m"])
    return found


AH = np.repeat([1e-4, 7e-4], 8), 0.17
"""Two tubes like an /a/: areas [m^2] and length [m]."""
EE = np.repeat([8e-4, 1e-4], [9, 6]), 0.165
"""Two tubes like an /i/."""
