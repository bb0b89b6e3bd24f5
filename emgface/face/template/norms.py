"""Norms of the lower face: means and standard deviations in millimetres, with their sources.

The standing of each number states how it was verified. "found": means and deviations are in the
cited table. "assumption": the number is quoted from the literature without access to the source,
was derived, or was chosen, as stated in the note.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

import pandas as pd

from emgface.texts import module_rows

NORM_SOURCES: Final = {
    "FACIAL_NORMS": "3D Facial Norms, Weinberg et al. 2016, Cleft Palate Craniofac J 53:e185-e197 (2454 "
    "white North Americans), at 25 years as smoothed over age in the open statistics of Cliniface "
    "(data/stats)",
    "KESTERKE": "Kesterke et al. 2016, Biol Sex Differ 7:23, 3D Facial Norms at 19 to 25 years",
    "FARKAS": "Farkas 1994, Anthropometry of the Head and Face, 2nd ed., North American young adults",
    "STEPHAN": "Stephan and Simpson 2008, J Forensic Sci 53:1257-1272, adults",
    "ARNETT": "Arnett et al. 1999, Am J Orthod Dentofacial Orthop 116:239-253, adults, relaxed lips",
    "CHOPRA": "Chopra et al. 2015, Aesthet Surg J 35:1007-1013",
    "OWN": "choice of this template",
}
"""Sources by the key of the table."""

Standing = Literal["found", "assumption"]


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


def read_norms(module: str, sources: Mapping[str, str]) -> tuple[Norm, ...]:
    """Norms of the table of a module, whose column ``source`` contains keys of the sources."""
    norms = list[Norm]()
    for row in module_rows(module):
        numbers = [float(row[name]) for name in ("men", "men_sd", "women", "women_sd")]
        bounds = float(row["smallest"]), float(row["largest"])
        men, women = (numbers[0], numbers[1]), (numbers[2], numbers[3])
        standing: Standing = "found" if row["standing"] == "found" else "assumption"
        about = sources[row["source"]], standing, row["note"]
        norms.append(Norm(row["name"], row["landmarks"], men, women, bounds, *about))
    return tuple(norms)


NORMS: Final = read_norms(__file__, NORM_SOURCES)
"""All measures, of ``norms.csv``; `norms_table` tabulates them."""


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
