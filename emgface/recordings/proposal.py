"""Proposed meanings of the labels of a file, to be confirmed by the user.

A proposal is a table; `mapping_text` writes it as a mapping file for
`emgface.recordings.labels.read_label_map`, with unresolved labels as comments.
"""

import json
import re
from collections.abc import Iterable, Mapping
from typing import Final, Literal

import pandas as pd
import xarray as xr

from emgface.errors import DataError
from emgface.muscles import CHANNELS, FACE_MARKERS, LIP_MARKERS
from emgface.recordings.places import with_places
from emgface.recordings.words import (
    AMBIGUOUS,
    FILLERS,
    MUSCLE_WORDS,
    OTHER_MUSCLES,
    PLACES,
    SIDE_WORDS,
)
from emgface.schema.rules import nearest

PROPOSAL_COLUMNS: Final = ("label", "name", "certainty", "reason")


def propose_for(
    recording: xr.Dataset, *, side: Literal["L", "R"] | None = None
) -> dict[Literal["channel", "marker"], pd.DataFrame]:
    """Propose the meaning of every channel and marker of a recording, by kind (`propose_mapping`).

    In addition to labels, the column ``target_muscle`` is used for channels of a BIDS dataset, and
    positions (`emgface.recordings.places`) for markers. `side` is that of channels whose label
    contains none.
    """
    tables: dict[Literal["channel", "marker"], pd.DataFrame] = {}
    if "channel" in recording.coords:
        electrodes = json.loads(str(recording.attrs.get("electrodes", "{}")))
        targets = {
            str(label): str(link["target_muscle"])
            for label, link in electrodes.get("channels", {}).items()
            if "target_muscle" in link
        }
        labels = [str(label) for label in recording["channel"].values]
        tables["channel"] = propose_mapping(labels, "channel", side=side, targets=targets)
    if "marker" in recording.coords:
        table = propose_mapping([str(label) for label in recording["marker"].values], "marker")
        tables["marker"] = with_places(table, recording["position"])
    return tables


def propose_mapping(
    labels: Iterable[str],
    kind: Literal["channel", "marker"] = "channel",
    *,
    side: Literal["L", "R"] | None = None,
    targets: Mapping[str, str] | None = None,
) -> pd.DataFrame:
    """Propose the meaning of each label of a file.

    `kind` is ``channel`` for muscles and side, ``marker`` for positions on the face; `side` is that
    of channels whose label contains none, and `targets` contains further information on a label in the
    source, such as the target muscle. The table has one row per label, in their order: ``label``;
    ``name`` (of the study, empty if unresolved); ``certainty`` (``sure``: a known name or words;
    ``likely``: a similar spelling; ``unresolved``); ``reason``. No name is assigned twice: if
    several labels fit one name, all remain unresolved unless exactly one is sure. Raises DataError
    if the kind is unknown.

    Examples
    --------
    >>> propose_mapping(["Left Zygomaticus", "EMG 7"])["name"].to_list()
    ['ZYG_L', '']
    """
    if kind not in ("channel", "marker"):
        raise DataError(f"Unknown kind of label {kind!r}; expected 'channel' or 'marker'.")
    rows = [(str(label), *_one(str(label), kind, side)) for label in labels]
    for k, (label, name, _, _) in enumerate(rows):
        if not name and targets and label in targets:
            name, certainty, reason = _one(f"{targets[label]} {label}", kind, side)
            certainty = "likely" if name else certainty
            rows[k] = (label, name, certainty, f"its target muscle is {targets[label]!r}: {reason}")
    table = pd.DataFrame(rows, columns=list(PROPOSAL_COLUMNS))
    for name in sorted(set(table["name"]) - {""}):
        claims = table["name"] == name
        if claims.sum() < 2:
            continue
        sure = claims & (table["certainty"] == "sure")
        loose = claims & ~sure if sure.sum() == 1 else claims
        others = ", ".join(repr(label) for label in table.loc[claims, "label"])
        table.loc[loose, "reason"] = f"{others} all match {name}"
        table.loc[loose, "certainty"] = "unresolved"
        table.loc[loose, "name"] = ""
    return table


def missing_names(table: pd.DataFrame, kind: Literal["channel", "marker"] = "channel") -> list[str]:
    """Return the names of a study, in its order, for which no label was proposed."""
    names = CHANNELS if kind == "channel" else FACE_MARKERS + LIP_MARKERS
    return [name for name in names if name not in set(table["name"])]


def mapping_text(channels: pd.DataFrame | None, markers: pd.DataFrame | None = None) -> str:
    """Write proposals (or None) as a mapping file in TOML.

    Likely names have a comment; unresolved labels are comments to be completed or deleted.
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


def _one(label: str, kind: str, assumed: str | None = None) -> tuple[str, str, str]:
    """Name, certainty and reason of one label."""
    names = CHANNELS if kind == "channel" else FACE_MARKERS + LIP_MARKERS
    exact = next((name for name in names if name.lower() == label.strip().lower()), None)
    if exact is not None:
        return exact, "sure", "exact name"
    words, side = _words(label, kind)
    text = " ".join(words)
    what, certainty = _known(text, _table(kind))
    if what is None:
        noun = "muscle" if kind == "channel" else "place"
        result = f"several {noun}s" if certainty == "several" else f"no known {noun}"
        return "", "unresolved", f"{result} in it"
    if what in OTHER_MUSCLES:
        return "", "unresolved", f"{what}, a muscle that the study does not record"
    if what in AMBIGUOUS:
        return "", "unresolved", AMBIGUOUS[what]
    if kind == "marker" and what in names:
        name = what  # on the midline
    elif side is None and (assumed is None or kind == "marker"):
        return "", "unresolved", f"{what}, but no side in it"
    elif side is None:
        return f"{what}_{assumed}", "likely", f"{what} without a side, which was given for all"
    elif kind == "channel":
        name = f"{what}_{side}"
    else:
        name = f"{what}_{'left' if side == 'L' else 'right'}"
    reason = "words known" if certainty == "sure" else f"{text!r} resembles {what}"
    return name, certainty, reason


def _words(label: str, kind: str) -> tuple[list[str], str | None]:
    """Words of a label without fillers, and the side in it."""
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", label)
    words = re.findall(r"[^\W\d_]+", spaced.lower())
    sides = [SIDE_WORDS[word] for word in words if word in SIDE_WORDS]
    side = sides[0] if len(set(sides)) == 1 else None
    kept = [w for w in words if w not in SIDE_WORDS and (w not in FILLERS or kind == "marker")]
    if side is None and not sides and kept:
        # A side without separation from the muscle, as in 'LZYG' or 'zygR'.
        for letter in "lr":
            for at in (0, -1):
                word = kept[at]
                bare = word.removeprefix(letter) if at == 0 else word.removesuffix(letter)
                if bare != word and any(bare in texts for texts in _table(kind).values()):
                    kept[at] = bare
                    return kept, letter.upper()
    return kept, side


def _table(kind: str) -> Mapping[str, tuple[str, ...]]:
    if kind == "marker":
        return PLACES
    return {**MUSCLE_WORDS, **OTHER_MUSCLES, **{phrase: (phrase,) for phrase in AMBIGUOUS}}


def _known(text: str, known: Mapping[str, tuple[str, ...]]) -> tuple[str | None, str]:
    """Return the name that a text matches, and its certainty."""
    flat = {phrase: what for what, phrases in known.items() for phrase in phrases}
    if text in flat:
        return flat[text], "sure"
    # The longest known phrase in the text, as whole words.
    inside = [p for p in flat if f" {p} " in f" {text} "]
    if inside:
        best = max(inside, key=len)
        rivals = {flat[p] for p in inside if p not in best and flat[p] not in AMBIGUOUS}
        if not rivals - {flat[best]}:
            return flat[best], "sure"
        return None, "several"
    close = nearest(text, flat, cutoff=0.8) if len(text) > 3 else None
    return (flat[close], "likely") if close else (None, "unresolved")
