"""Norms of the lower face: means and standard deviations in millimetres, with their sources.

The standing of each number states how it was verified. "found": means and deviations are in the
cited table. "assumption": the number is quoted from the literature without access to the source,
was derived, or was chosen, as stated in the note.
"""

from dataclasses import dataclass
from typing import Final, Literal

import pandas as pd

FACIAL_NORMS: Final = (
    "3D Facial Norms, Weinberg et al. 2016, Cleft Palate Craniofac J 53:e185-e197 (2454 white North "
    "Americans), at 25 years as smoothed over age in the open statistics of Cliniface (data/stats)"
)
KESTERKE: Final = "Kesterke et al. 2016, Biol Sex Differ 7:23, 3D Facial Norms at 19 to 25 years"
FARKAS: Final = (
    "Farkas 1994, Anthropometry of the Head and Face, 2nd ed., North American young adults"
)
STEPHAN: Final = "Stephan and Simpson 2008, J Forensic Sci 53:1257-1272, adults"
ARNETT: Final = (
    "Arnett et al. 1999, Am J Orthod Dentofacial Orthop 116:239-253, adults, relaxed lips"
)
CHOPRA: Final = "Chopra et al. 2015, Aesthet Surg J 35:1007-1013"
OWN: Final = "choice of this template"

Standing = Literal["found", "assumption"]
_QUOTED: Final = "as commonly quoted; the source was not available"
_SHAPE: Final = "shapes the template; no published norm is claimed"


@dataclass(frozen=True)
class Norm:
    """One measure: mean and standard deviation of men and women, bounds and source."""

    name: str  #: field of `Measures`
    landmarks: str  #: landmarks between which it is measured
    men: tuple[float, float]  #: mean and standard deviation [mm]
    women: tuple[float, float]  #: mean and standard deviation [mm]
    bounds: tuple[float, float]  #: smallest and largest accepted value [mm]
    source: str  #: source of the numbers
    standing: Standing  #: verification of the numbers, see the module
    note: str  #: further remarks


# fmt: off
NORMS: Final = (
    Norm("mouth_width", "cheilion to cheilion", (50.1, 3.8), (47.9, 3.5), (33, 70),
         FACIAL_NORMS, "found", ""),
    Norm("philtrum_width", "between the crests of the philtrum", (13.1, 1.7), (11.8, 1.7), (5, 20),
         FACIAL_NORMS, "found", ""),
    Norm("upper_lip_height", "subnasale to stomion", (22.6, 2.5), (20.3, 2.4), (11, 31),
         FACIAL_NORMS, "found", ""),
    Norm("upper_vermilion_height", "labrale superius to stomion", (7.6, 1.6), (7.4, 1.4), (3, 14),
         FACIAL_NORMS, "found", ""),
    Norm("lower_vermilion_height", "stomion to labrale inferius", (8.7, 2.1), (8.6, 1.7), (4, 15),
         FACIAL_NORMS, "found", ""),
    Norm("lower_lip_height", "stomion to sublabiale", (19.7, 1.9), (17.8, 1.7), (10, 27),
         FARKAS, "assumption", _QUOTED),
    Norm("chin_height", "stomion to gnathion", (47.3, 4.4), (43.2, 3.1), (27, 66),
         FACIAL_NORMS, "assumption",
         "means: nasion-gnathion 126.6 and 118.0 less nose and upper lip, all found; spread quoted"),
    Norm("nose_height", "nasion to subnasale", (56.7, 3.9), (54.5, 3.6), (33, 70),
         FACIAL_NORMS, "found", ""),
    Norm("nose_width", "alare to alare", (35.9, 2.6), (32.7, 2.3), (19, 48),
         FACIAL_NORMS, "found", ""),
    Norm("nose_protrusion", "subnasale to pronasale", (21.1, 1.9), (20.0, 1.6), (12, 30),
         KESTERKE, "assumption", "means as quoted from its additional file 1; spread assumed"),
    Norm("face_width", "zygion to zygion", (137.1, 6.3), (130.1, 5.3), (95, 160),
         FACIAL_NORMS, "found", ""),
    Norm("jaw_width", "gonion to gonion", (103.7, 7.1), (97.0, 6.5), (62, 125),
         FACIAL_NORMS, "found", ""),
    Norm("face_depth", "subnasale to the frontal plane of the tragia",
         (107.0, 4.5), (100.0, 4.0), (70, 125),
         OWN, "assumption",
         "estimated from subnasale-tragion distances and the width between the tragia"),
    Norm("upper_lip_protrusion", "upper lip in front of the vertical through subnasale",
         (3.3, 1.7), (3.7, 1.2), (0.2, 10), ARNETT, "assumption", _QUOTED),
    Norm("lower_lip_protrusion", "lower lip in front of the vertical through subnasale",
         (1.0, 2.2), (1.9, 1.4), (-5, 9), ARNETT, "assumption", _QUOTED),
    Norm("chin_protrusion", "pogonion in front of (+) or behind (-) the vertical through subnasale",
         (-3.5, 1.8), (-2.6, 1.9), (-9, 5), ARNETT, "assumption", _QUOTED),
    Norm("cheek_fullness", "bulge of the cheek", (4.0, 1.5), (5.0, 1.5), (-2, 10),
         OWN, "assumption", _SHAPE),
    Norm("cheekbone_prominence", "bulge over the zygoma", (5.0, 1.2), (5.0, 1.2), (0, 10),
         OWN, "assumption", _SHAPE),
    Norm("jaw_rise", "rise of the lower border of the jaw from chin to angle",
         (32.0, 4.0), (30.0, 4.0), (15, 45), OWN, "assumption", _SHAPE),
    Norm("cupid_bow", "height of the peaks of the Cupid's bow", (1.2, 0.4), (1.4, 0.4), (0, 3),
         OWN, "assumption", _SHAPE),
    Norm("lip_gap", "opening of the relaxed lips in the midline", (2.4, 1.1), (3.3, 1.3), (1.0, 7),
         ARNETT, "assumption", _QUOTED),
    Norm("skin_thickness", "outer layer", (1.6, 0.15), (1.5, 0.15), (0.8, 3),
         CHOPRA, "assumption",
         "within the 0.76 to 1.97 mm of dermis found over the face; one value for all regions"),
    Norm("upper_lip_thickness", "vermilion to upper incisor", (14.8, 1.4), (12.6, 1.8), (6, 20),
         ARNETT, "assumption", _QUOTED),
    Norm("lower_lip_thickness", "vermilion to lower incisor", (15.1, 1.2), (13.6, 1.4), (6, 20),
         ARNETT, "assumption", _QUOTED),
    Norm("philtrum_thickness", "mid-philtrum to bone", (11.0, 1.5), (10.0, 1.5), (5, 16),
         STEPHAN, "assumption", f"rounded; {_QUOTED}"),
    Norm("chin_thickness", "pogonion to bone", (13.5, 2.3), (11.8, 1.5), (5, 20),
         ARNETT, "assumption", _QUOTED),
    Norm("jaw_thickness", "menton to bone, and along the border of the jaw",
         (8.8, 1.3), (7.4, 1.6), (2.8, 13), ARNETT, "assumption", _QUOTED),
    Norm("cheekbone_thickness", "skin to zygoma and infraorbital rim", (7.5, 1.2), (8.0, 1.2),
         (4, 12), STEPHAN, "assumption", f"rounded, zygion and infraorbital together; {_QUOTED}"),
    Norm("cheek_thickness", "skin to the lining of the cheek", (11.0, 1.2), (11.5, 1.2), (6, 16),
         OWN, "assumption",
         "of the soft tissue that moves; neither masseter nor the fat pad behind it"),
    Norm("nose_thickness", "skin to nasal bone and cartilage", (5.5, 0.8), (5.5, 0.8), (2.5, 9),
         STEPHAN, "assumption", f"rounded, nasion to nasal bone, wide at the wings; {_QUOTED}"),
)
# fmt: on
"""All measures; `norms_table` tabulates them."""


def norms_table() -> pd.DataFrame:
    """Means, standard deviations, bounds [mm], source, standing and note of every measure."""
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
            "standing": norm.standing,
            "note": norm.note,
        }
        for norm in NORMS
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("measure")
