"""Proposals of what the labels of a file mean, for a person to confirm.

A proposal is a table; `mapping_text` writes it as the mapping file that
`emgface.recordings.labels.read_label_map` reads, unresolved labels as comments.
"""

import json
import re
from collections.abc import Iterable, Mapping
from typing import Final, Literal

import pandas as pd

from emgface.errors import DataError
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.schema.rules import nearest

COLUMNS: Final = ("label", "name", "certainty", "reason")

_LEFT: Final = ("l", "left", "li", "links", "lt", "lft", "gauche", "g", "sin", "sinister")
_RIGHT: Final = ("r", "right", "re", "rechts", "rt", "rgt", "droit", "droite", "dex", "dexter")
SIDES: Final[Mapping[str, str]] = {**dict.fromkeys(_LEFT, "L"), **dict.fromkeys(_RIGHT, "R")}
"""Words for a side, in English, Dutch, German, French and Latin."""

MUSCLES: Final[Mapping[str, tuple[str, ...]]] = {
    "OOS": ("oos", "orbicularis oris superior", "orb oris sup", "orbicularis superior",
            "upper orbicularis", "orbicularis oris upper", "upper lip"),
    "OOI": ("ooi", "orbicularis oris inferior", "orb oris inf", "orbicularis inferior",
            "lower orbicularis", "orbicularis oris lower", "lower lip"),
    "RIS": ("ris", "risorius"),
    "ZYG": ("zyg", "zygomaticus", "zygomaticus major", "zygomatic", "zm", "zmaj", "zygo"),
    "LLSAN": ("llsan", "levator labii superioris alaeque nasi", "levator labii superioris",
              "levator labii", "lls", "levator"),
    "DAO": ("dao", "depressor anguli oris", "depressor anguli", "triangularis"),
    "MEN": ("men", "ment", "mentalis", "chin"),
}  # fmt: skip
"""Words for the muscles that carry electrodes."""

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

_FILLERS: Final = frozenset(
    ("emg", "semg", "m", "musc", "muscle", "musculus", "ch", "channel", "chan", "marker", "mk",
     "sensor", "raw", "bip", "bipolar", "of", "the", "v", "uv", "mv", "analog", "voltage"),
)  # fmt: skip
"""Words that tell neither muscle nor side."""


def propose_mapping(
    labels: Iterable[str], kind: Literal["channel", "marker"] = "channel"
) -> pd.DataFrame:
    """Propose what each label of a file means.

    Parameters
    ----------
    labels : iterable of str
        Labels in the file.
    kind : str
        ``channel`` for muscles and side, ``marker`` for places on the face.

    Returns
    -------
    DataFrame
        One row per label, in their order: ``label``; ``name`` (of the study, empty where
        unresolved); ``certainty`` (``sure``: a name or words known; ``likely``: a spelling close
        to one; ``unresolved``); ``reason``. No name is given twice: where several labels claim
        one, all stay unresolved unless one alone is sure.

    Raises
    ------
    DataError
        If the kind is another.

    Examples
    --------
    >>> propose_mapping(["Left Zygomaticus", "EMG 7"])["name"].to_list()
    ['ZYG_L', '']
    """
    if kind not in ("channel", "marker"):
        raise DataError(f"No kind of label is called {kind!r}; expected 'channel' or 'marker'.")
    rows = [(str(label), *_one(str(label), kind)) for label in labels]
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    for name in sorted(set(table["name"]) - {""}):
        claims = table["name"] == name
        if claims.sum() < 2:
            continue
        sure = claims & (table["certainty"] == "sure")
        loose = claims & ~sure if sure.sum() == 1 else claims
        others = ", ".join(repr(label) for label in table.loc[claims, "label"])
        table.loc[loose, "reason"] = f"{others} all look like {name}"
        table.loc[loose, "certainty"] = "unresolved"
        table.loc[loose, "name"] = ""
    return table


def missing_names(table: pd.DataFrame, kind: Literal["channel", "marker"] = "channel") -> list[str]:
    """Return the names of a study that no label was proposed for.

    Parameters
    ----------
    table : DataFrame
        Result of `propose_mapping`.
    kind : str
        As there.

    Returns
    -------
    list of str
        Names, in the order of the study.
    """
    names = CHANNELS if kind == "channel" else FACE_MARKERS + LIP_MARKERS
    return [name for name in names if name not in set(table["name"])]


def mapping_text(channels: pd.DataFrame | None, markers: pd.DataFrame | None = None) -> str:
    """Write proposals as a mapping file in TOML.

    Parameters
    ----------
    channels, markers : DataFrame or None
        Results of `propose_mapping`.

    Returns
    -------
    str
        Tables ``channels`` and ``markers``; likely names carry a comment, unresolved labels are
        comments that a person completes or deletes.
    """
    lines: list[str] = []
    for title, table, kind in (("channels", channels, "channel"), ("markers", markers, "marker")):
        if table is None or table.empty:
            continue
        lines.append(f"[{title}]")
        for row in table.itertuples(index=False):
            label = json.dumps(str(row.label), ensure_ascii=False)  # a basic string of TOML
            if row.name:
                doubt = f"  # {row.reason}" if row.certainty != "sure" else ""
                lines.append(f'{label} = "{row.name}"{doubt}')
            else:
                lines.append(f'# {label} = ""  # unresolved: {row.reason}')
        lacking = missing_names(table, "channel" if kind == "channel" else "marker")
        if lacking:
            lines.append(f"# no label found for: {', '.join(lacking)}")
        lines.append("")
    return "\n".join(lines)


def _one(label: str, kind: str) -> tuple[str, str, str]:
    """Name, certainty and reason of one label."""
    names = CHANNELS if kind == "channel" else FACE_MARKERS + LIP_MARKERS
    exact = next((name for name in names if name.lower() == label.strip().lower()), None)
    if exact is not None:
        return exact, "sure", "the name itself"
    words, side = _words(label, kind)
    known = MUSCLES if kind == "channel" else PLACES
    text = " ".join(words)
    what, certainty = _known(text, known)
    if what is None:
        return "", "unresolved", f"no known {'muscle' if kind == 'channel' else 'place'} in it"
    if kind == "marker" and what in names:
        name = what  # on the midline
    elif side is None:
        return "", "unresolved", f"{what}, but no side in it"
    elif kind == "channel":
        name = f"{what}_{side}"
    else:
        name = f"{what}_{'left' if side == 'L' else 'right'}"
    reason = "words known" if certainty == "sure" else f"{text!r} is spelled like {what}"
    return name, certainty, reason


def _words(label: str, kind: str) -> tuple[list[str], str | None]:
    """Words of a label without fillers, and the side in it."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    words = re.findall(r"[^\W\d_]+", spaced.lower())
    sides = [SIDES[word] for word in words if word in SIDES]
    side = sides[0] if len(set(sides)) == 1 else None
    kept = [w for w in words if w not in SIDES and (w not in _FILLERS or kind == "marker")]
    if side is None and not sides and kept:
        # A side glued to the muscle, as in 'LZYG' or 'zygR'.
        for letter in "lr":
            for at in (0, -1):
                word = kept[at]
                bare = word.removeprefix(letter) if at == 0 else word.removesuffix(letter)
                if bare != word and any(bare in texts for texts in _table(kind).values()):
                    kept[at] = bare
                    return kept, letter.upper()
    return kept, side


def _table(kind: str) -> Mapping[str, tuple[str, ...]]:
    return MUSCLES if kind == "channel" else PLACES


def _known(text: str, known: Mapping[str, tuple[str, ...]]) -> tuple[str | None, str]:
    """Return what a text names, and how certain it is."""
    flat = {phrase: what for what, phrases in known.items() for phrase in phrases}
    if text in flat:
        return flat[text], "sure"
    # The longest known phrase inside the text, as whole words.
    inside = [p for p in flat if f" {p} " in f" {text} "]
    if inside:
        best = max(inside, key=len)
        rivals = {flat[p] for p in inside if p not in best}
        if not rivals - {flat[best]}:
            return flat[best], "sure"
        return None, "unresolved"
    close = nearest(text, flat, cutoff=0.8) if len(text) > 3 else None
    return (flat[close], "likely") if close else (None, "unresolved")
