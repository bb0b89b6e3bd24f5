"""Norms of the lower face: means and spreads in millimetres, with sources and how sure they are."""

from dataclasses import dataclass
from typing import Final

import pandas as pd

FARKAS: Final = (
    "Farkas 1994, Anthropometry of the Head and Face, 2nd ed., North American young adults"
)
FARKAS_2005: Final = "Farkas et al. 2005, J Craniofac Surg 16:615-646, North American whites"
STEPHAN: Final = "Stephan and Simpson 2008, J Forensic Sci 53:1257-1272, adults"
ARNETT: Final = (
    "Arnett et al. 1999, Am J Orthod Dentofacial Orthop 116:239-253, adults, relaxed lips"
)
OWN: Final = "choice of this template"
_COMMON: Final = "as commonly quoted from the source; not compared with its tables"
_SHAPE: Final = "shapes the template; no published norm is claimed"


@dataclass(frozen=True)
class Norm:
    """One measure: mean and standard deviation of men and women, bounds and source.

    Attributes
    ----------
    name : str
        Field of `Measures`.
    landmarks : str
        What is measured between.
    men, women : tuple of float
        Mean and standard deviation [mm].
    bounds : tuple of float
        Smallest and largest value accepted [mm].
    source, note : str
        Where the numbers come from and how sure they are.
    """

    name: str
    landmarks: str
    men: tuple[float, float]
    women: tuple[float, float]
    bounds: tuple[float, float]
    source: str
    note: str


# fmt: off
NORMS: Final = (
    Norm("mouth_width", "cheilion to cheilion", (54.5, 3.0), (50.2, 3.5), (33, 70),
         FARKAS_2005, _COMMON),
    Norm("philtrum_width", "between the crests of the philtrum", (11.0, 1.5), (9.5, 1.5), (5, 18),
         OWN, "of the size commonly reported; spread assumed"),
    Norm("upper_lip_height", "subnasale to stomion", (22.3, 2.1), (20.1, 2.0), (11, 31),
         FARKAS, _COMMON),
    Norm("upper_vermilion_height", "labrale superius to stomion", (8.0, 1.4), (8.7, 1.3), (3, 14),
         FARKAS, _COMMON),
    Norm("lower_vermilion_height", "stomion to labrale inferius", (9.3, 1.6), (9.4, 1.5), (4, 15),
         FARKAS, _COMMON),
    Norm("lower_lip_height", "stomion to sublabiale", (19.7, 1.9), (17.8, 1.7), (10, 27),
         FARKAS, _COMMON),
    Norm("chin_height", "stomion to gnathion", (50.7, 4.4), (43.4, 3.1), (27, 66),
         FARKAS, _COMMON),
    Norm("nose_height", "nasion to subnasale", (54.8, 3.3), (50.6, 3.1), (33, 68),
         FARKAS_2005, _COMMON),
    Norm("nose_width", "alare to alare", (34.9, 2.1), (31.4, 2.0), (19, 48),
         FARKAS_2005, _COMMON),
    Norm("nose_protrusion", "subnasale to pronasale", (19.5, 1.9), (19.7, 1.6), (12, 28),
         FARKAS, _COMMON),
    Norm("face_width", "zygion to zygion", (137.1, 4.3), (129.9, 5.3), (95, 160),
         FARKAS_2005, _COMMON),
    Norm("jaw_width", "gonion to gonion", (97.1, 5.8), (91.1, 5.9), (62, 125),
         FARKAS_2005, _COMMON),
    Norm("face_depth", "subnasale to the frontal plane of the tragia",
         (107.0, 4.5), (100.0, 4.0), (70, 125),
         OWN, "estimated from subnasale-tragion distances and the width between the tragia"),
    Norm("upper_lip_protrusion", "upper lip before the vertical through subnasale",
         (3.3, 1.7), (3.7, 1.2), (0.2, 10), ARNETT, _COMMON),
    Norm("lower_lip_protrusion", "lower lip before the vertical through subnasale",
         (1.0, 2.2), (1.9, 1.4), (-5, 9), ARNETT, _COMMON),
    Norm("chin_protrusion", "pogonion before (+) or behind (-) the vertical through subnasale",
         (-3.5, 1.8), (-2.6, 1.9), (-9, 5), ARNETT, _COMMON),
    Norm("cheek_fullness", "bulge of the cheek", (4.0, 1.5), (5.0, 1.5), (-2, 10), OWN, _SHAPE),
    Norm("cheekbone_prominence", "bulge over the zygoma", (5.0, 1.2), (5.0, 1.2), (0, 10),
         OWN, _SHAPE),
    Norm("jaw_rise", "rise of the lower border of the jaw from chin to angle",
         (32.0, 4.0), (30.0, 4.0), (15, 45), OWN, _SHAPE),
    Norm("cupid_bow", "height of the peaks of the Cupid's bow", (1.2, 0.4), (1.4, 0.4), (0, 3),
         OWN, _SHAPE),
    Norm("lip_gap", "opening of the relaxed lips in the midline", (2.4, 1.1), (3.3, 1.3), (0.8, 7),
         ARNETT, _COMMON),
    Norm("skin_thickness", "outer layer", (1.6, 0.15), (1.5, 0.15), (0.8, 3),
         OWN, "about 1.5 mm"),
    Norm("upper_lip_thickness", "vermilion to upper incisor", (14.8, 1.4), (12.6, 1.8), (6, 20),
         ARNETT, _COMMON),
    Norm("lower_lip_thickness", "vermilion to lower incisor", (15.1, 1.2), (13.6, 1.4), (6, 20),
         ARNETT, _COMMON),
    Norm("philtrum_thickness", "mid-philtrum to bone", (11.0, 1.5), (10.0, 1.5), (5, 16),
         STEPHAN, f"rounded; {_COMMON}"),
    Norm("chin_thickness", "pogonion to bone", (13.5, 2.3), (11.8, 1.5), (5, 20),
         ARNETT, _COMMON),
    Norm("jaw_thickness", "menton to bone, and along the border of the jaw",
         (8.8, 1.3), (7.4, 1.6), (2.8, 13), ARNETT, _COMMON),
    Norm("cheekbone_thickness", "skin to zygoma and infraorbital rim", (7.5, 1.2), (8.0, 1.2),
         (4, 12), STEPHAN, f"rounded, zygion and infraorbital together; {_COMMON}"),
    Norm("cheek_thickness", "skin to the lining of the cheek", (11.0, 1.2), (11.5, 1.2), (6, 16),
         OWN, "of the soft tissue that moves; neither masseter nor the fat pad behind it"),
    Norm("nose_thickness", "skin to nasal bone and cartilage", (5.5, 0.8), (5.5, 0.8), (2.5, 9),
         STEPHAN, f"rounded, nasion to nasal bone, wide at the wings; {_COMMON}"),
)
# fmt: on
"""Every measure; `norms_table` shows it."""


def norms_table() -> pd.DataFrame:
    """Every measure with means, standard deviations, bounds [mm], source and note.

    Returns
    -------
    pandas.DataFrame
        Index `measure`.
    """
    rows = {
        norm.name: {
            "between": norm.landmarks,
            "men": norm.men[0],
            "men_sd": norm.men[1],
            "women": norm.women[0],
            "women_sd": norm.women[1],
            "smallest": norm.bounds[0],
            "largest": norm.bounds[1],
            "source": norm.source,
            "note": norm.note,
        }
        for norm in NORMS
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("measure")
