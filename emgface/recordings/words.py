"""Words used in laboratories for sides, muscles and positions on the face.

Names of muscles follow the guidelines of Fridlund and Cacioppo (1986, Psychophysiology 23:567-589)
and Terminologia Anatomica; abbreviations are those of published facial EMG.
"""

from collections.abc import Mapping
from typing import Final

_LEFT: Final = ("l", "left", "li", "links", "lt", "lft", "gauche", "g", "sin", "sinister")
_RIGHT: Final = ("r", "right", "re", "rechts", "rt", "rgt", "droit", "droite", "dex", "dexter")
SIDES: Final[Mapping[str, str]] = {**dict.fromkeys(_LEFT, "L"), **dict.fromkeys(_RIGHT, "R")}
"""Words for a side, in English, Dutch, German, French and Latin."""

MUSCLES: Final[Mapping[str, tuple[str, ...]]] = {
    "OOS": ("oos", "orbicularis oris superior", "orb oris sup", "orbicularis superior",
            "upper orbicularis", "orbicularis oris upper", "upper lip", "oo sup", "oo superior",
            "oris sup", "oris superior", "orbicularis oris sup", "oo up", "oo upper", "oberlippe",
            "bovenlip"),
    "OOI": ("ooi", "orbicularis oris inferior", "orb oris inf", "orbicularis inferior",
            "lower orbicularis", "orbicularis oris lower", "lower lip", "oo inf", "oo inferior",
            "oris inf", "oris inferior", "orbicularis oris inf", "oo low", "oo lower", "unterlippe",
            "onderlip"),
    "RIS": ("ris", "risorius"),
    "ZYG": ("zyg", "zygomaticus", "zygomaticus major", "zygomatic", "zygomatic major", "zm", "zmaj",
            "zygo", "zyg maj", "zyg major", "zygo maj", "zygmaj", "zygom", "z maj"),
    "LLSAN": ("llsan", "llan", "levator labii superioris alaeque nasi",
              "levator labii superioris alesque nasi", "levator labii superioris", "levator labii",
              "lls", "lev", "levator", "lev lab sup", "lev labii", "lev lab"),
    "DAO": ("dao", "depressor anguli oris", "depressor anguli", "triangularis", "dep ang oris",
            "depr ang oris"),
    "MEN": ("men", "ment", "mentalis", "chin", "mental", "kinn", "kin"),
}  # fmt: skip
"""Words for the muscles that are recorded."""

OTHER_MUSCLES: Final[Mapping[str, tuple[str, ...]]] = {
    "corrugator supercilii": ("corrugator", "corrugator supercilii", "corr", "cs", "corrug"),
    "depressor supercilii": ("depressor supercilii",),
    "frontalis": ("frontalis", "lateral frontalis", "medial frontalis", "front", "frontal"),
    "procerus": ("procerus",),
    "orbicularis oculi": ("orbicularis oculi", "orb oculi", "oculi", "ooc", "oocc", "oc"),
    "nasalis": ("nasalis",),
    "zygomaticus minor": ("zygomaticus minor", "zyg min", "zyg minor", "zygomatic minor"),
    "levator anguli oris": ("levator anguli oris", "levator anguli", "caninus", "lao"),
    "depressor labii inferioris": ("depressor labii inferioris", "depressor labii", "dli"),
    "buccinator": ("buccinator", "bucc", "buc"),
    "masseter": ("masseter", "mass", "mas"),
    "temporalis": ("temporalis",),
    "digastric": ("digastric", "digastricus", "anterior belly of the digastric", "submental"),
    "platysma": ("platysma",),
    "sternocleidomastoid": ("sternocleidomastoid", "scm"),
    "tongue": ("tongue", "genioglossus"),
}  # fmt: skip
"""Words for muscles of the head that the study does not record; the model may move some of them."""
AMBIGUOUS: Final[Mapping[str, str]] = {
    "orbicularis oris": "orbicularis oris, but neither superior nor inferior is stated",
    "orb oris": "orbicularis oris, but neither superior nor inferior is stated",
    "oris": "orbicularis oris, but neither superior nor inferior is stated",
    "oo": "orbicularis oris, but neither superior nor inferior is stated",
    "orbicularis": "orbicularis, but neither oris superior, oris inferior nor oculi is stated",
    "depressor": "a depressor, but it is not stated which",
}
"""Words that fit several muscles, with the reason why a label is ambiguous."""

PLACES: Final[Mapping[str, tuple[str, ...]]] = {
    "forehead": ("forehead", "frontal", "brow", "stirn"),
    "temple": ("temple", "temporal", "schlaefe"),
    "nasion": ("nasion", "nose bridge", "nasal bridge", "bridge"),
    "rhinion": ("rhinion", "nose", "nose dorsum", "nose tip", "nasal dorsum"),
    "corner": ("corner", "mouth corner", "lip corner", "commissure", "cheilion", "ch", "mc"),
    "upper_lateral": ("upper lateral", "upper lip lateral", "ul lat", "upper lat", "sup lat"),
    "upper_paramedian": ("upper paramedian", "upper lip paramedian", "upper medial", "upper med",
                         "upper lip medial", "crista philtri", "cupid", "sup med", "ul med"),
    "lower_lateral": ("lower lateral", "lower lip lateral", "ll lat", "lower lat", "inf lat"),
    "lower_paramedian": ("lower paramedian", "lower lip paramedian", "lower medial", "lower med",
                         "lower lip medial", "inf med", "ll med"),
}  # fmt: skip
"""Words for the places of markers, without side."""

FILLERS: Final = frozenset(
    ("emg", "semg", "m", "musc", "muscle", "musculus", "ch", "channel", "chan", "marker", "mk",
     "sensor", "raw", "bip", "bipolar", "of", "the", "v", "uv", "mv", "analog", "voltage"),
)  # fmt: skip
"""Words that denote neither muscle nor side."""
