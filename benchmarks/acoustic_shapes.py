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
    shapes: dict[str, tuple[Floats, float]] = {}
    with (folder / "derived_vowel_areas_lips_to_glottis.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            areas = [float(v) for v in row["areas_cm2_from_lips_space_separated"].split()]
            shapes[row["vowel"]] = np.array(areas[::-1]) * 1e-4, 0.005 * len(areas)
    with (folder / "derived_area_functions.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            areas = [float(row[f"A{k}_cm2"]) for k in range(40)]
            shapes[row["index"]] = np.array(areas) * 1e-4, float(row["length_m"])
    return shapes


AH = np.repeat([1e-4, 7e-4], 8), 0.17
"""Two tubes like an /a/: areas [m^2] and length [m]."""
EE = np.repeat([8e-4, 1e-4], [9, 6]), 0.165
"""Two tubes like an /i/."""


def pipe(
    line: Floats, radius: Floats | float, *, flat: float = 1.0, around: int = 48
) -> tuple[Floats, NDArray[np.int64]]:
    """Surface round a line in the x-z plane: radii (n,), those across the plane times `flat`."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, [0.0, 1.0, 0.0])
    phi = 2 * np.pi * np.arange(around) / around
    # a polygon of the same area as the circle
    r = np.broadcast_to(radius, len(line)) * np.sqrt(
        2 * np.pi / around / np.sin(2 * np.pi / around)
    )
    x = line[:, None] + r[:, None, None] * (
        np.cos(phi)[None, :, None] * across[:, None]
        + flat * np.sin(phi)[None, :, None] * np.array([0.0, 1.0, 0.0])
    )
    i, j = np.meshgrid(np.arange(len(line) - 1), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    c, d = a + around, b + around
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    return x.reshape(-1, 3), faces


STRAIGHT = np.stack([np.linspace(0, 0.17, 120), np.zeros(120), np.zeros(120)], axis=1)
ANGLE = np.linspace(0, np.pi / 2, 160)
BENT = 0.1 * np.stack([np.sin(ANGLE), np.zeros(160), 1 - np.cos(ANGLE)], axis=1)


def published_airway(shared: Path) -> tuple[Floats, NDArray[np.int64], Floats]:
    """Skin of the tract of one speaker, and its centre line up to the lips, which go on to the face."""
    from emgface.anatomy.airway.sections import centre_line
    from emgface.face.artisynth_contact import read_obj

    path = shared / "artisynth_models" / "airway" / "badinairwaylips_morphed_n.obj"
    position, triangle = read_obj(path)
    start = np.array([0.126, 0.0, position[:, 2].min()])
    end = np.array([0.051, 0.0, 0.098])
    return position, triangle, centre_line(position, triangle, start, end=end, levels=60)
