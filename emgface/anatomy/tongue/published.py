"""Import of the published hexahedral tongue from the files of a user.

The files are those of the tongue of Buchaillard, Perrier and Payan 2009 as distributed with ArtiSynth
Models (folder `tongue3d/geometry` or `tongue`), with tables of elements and fibres of every muscle in a
folder `derived`. Their frame is x posterior, y right, z superior, in metres.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np
import pandas as pd
import xarray as xr

from emgface.anatomy.jaw.series import Excitation, started
from emgface.anatomy.tongue.model import build_tongue
from emgface.errors import TongueError
from emgface.face.ansys import read_elements, read_nodes, solid_nodes
from emgface.face.bundles import fibre_directions
from emgface.face.parts import Bundle, Fibre, Floats, Integers
from emgface.face.quality import element_centres
from emgface.schema.rules import one_line
from emgface.texts import labelled, open_text, read_text

Forces = Literal["standard", "strong"]

TONGUE_SOURCE = (
    "Buchaillard, Perrier and Payan 2009, A biomechanical model of cardinal vowel production; Stavness, "
    "Lloyd, Payan and Fels 2011; artisynth_models, tongue"
)
TURN = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Rotation of positions in the published frame into that of the package, x = TURN X."""
COUPLED_DISPLACEMENT = np.array([2e-3, 0.0, 0.0])
"""Displacement of the tongue when it is coupled to the jaw, in the published frame [m]."""
MARKER_NODES = {"tip": 919, "back": 869, "base": 927}
POSTURES = {
    "rest": "tongue_rest",
    "rest_il01": "tongue_rest_il01",
    "i": "tongue_ee",
    "jaw_open": "tongue_posture_jawOpen_rest",
    "jaw_closed": "tongue_posture_jawClose_nogravity",
    "jaw_open_a": "tongue_posture_jawOpen_a",
}
"""Files of the stored shapes, in millimetres except for the last, which is in metres."""
_FORCES = {"standard": "MuscleMaxForce.txt", "strong": "MuscleMaxForce40.txt"}
_ATTACHMENT_FILES = {"jaw": "jawAttachments.txt", "hyoid": "hyoidAttachments.txt"}


def import_tongue(
    folder: str | os.PathLike[str], *, forces: Forces = "standard", rest: str | None = None
) -> xr.Dataset:
    """Import the published tongue.

    Parameters
    ----------
    folder : path-like
        Folder with ``tongue.node``, or its parent; the stored shapes are read if a folder
        ``jaw_tongue_face/tongue_postures`` lies in the same folder.
    forces : "standard" or "strong"
        Largest forces of the muscles; the strong ones are about 1.8 times the others.
    rest : str, optional
        Stored shape (`POSTURES`) that is the rest shape, free of stress, as the coupled model uses
        ``rest_il01``; its nodes are 2 mm further back. By default the mesh is at rest.

    Returns
    -------
    xarray.Dataset
        Of schema tongue_model.

    Raises
    ------
    TongueError, FaceError
        A file is absent or cannot be read, or an option is unknown.
    """
    place = Path(folder)
    place = place if (place / "tongue.node").is_file() else place / "tongue"
    if forces not in _FORCES:
        raise TongueError(f"forces = {forces!r}, expected one of {', '.join(_FORCES)}")
    nodes, listed = read_nodes(_file(place, "tongue.node")), read_elements(place / "tongue.elem")
    X, connectivity = nodes.position, solid_nodes(listed, place / "tongue.elem") - 1
    shapes = _postures(place.parent / "jaw_tongue_face" / "tongue_postures", X)
    outside = _table(place / "derived" / "extra_nodes.csv", ["node", "x_m", "y_m", "z_m"])
    styloid = outside[["x_m", "y_m", "z_m"]].to_numpy(dtype=np.float64)
    if rest is not None:
        if rest not in shapes:
            raise TongueError(f"no stored shape {rest!r}, expected one of {', '.join(shapes)}")
        X = X + COUPLED_DISPLACEMENT + shapes[rest]
        styloid = styloid + COUPLED_DISPLACEMENT
        shapes = {name: d - shapes[rest] for name, d in shapes.items()}
    fibres = _fibres(place, np.concatenate([X, styloid]), len(X))
    bundles = _bundles(place, fibres, element_centres(X, connectivity))
    return build_tongue(
        position=X @ TURN.T,
        connectivity=connectivity,
        attachments={body: _positions(place / name) for body, name in _ATTACHMENT_FILES.items()},
        fibres=[Fibre(f.muscle, f.position @ TURN.T, f.node, f.body) for f in fibres],
        bundles=[Bundle(b.muscle, b.element, b.direction @ TURN.T) for b in bundles],
        force_max=_forces(place / _FORCES[forces], [b.muscle for b in bundles]),
        markers=MARKER_NODES,
        name="published tongue" if rest is None else f"published tongue, rest shape {rest}",
        origin="published geometry, imported",
        source=TONGUE_SOURCE,
        node_id=nodes.id,
        element_id=listed.id,
        contour=_positions(place / "tongueContourNodes.txt"),
        postures={name: d @ TURN.T for name, d in shapes.items()},
        attrs={"forces": forces, "rest": rest or "mesh"},
    )


def _fibres(place: Path, points: Floats, n_nodes: int) -> list[Fibre]:
    """Fibres as chains of nodes; those of styloglossus end at the styloid process of the skull."""
    table = _table(place / "derived" / "muscle_fibres.csv", ["muscle", "fibre", "seq", "node"])
    chains = list[Fibre]()
    for (muscle, _), rows in table.groupby(["muscle", "fibre"], sort=False):
        node = rows.sort_values("seq")["node"].to_numpy(dtype=np.int64) - 1
        ends = "skull" if (node >= n_nodes).any() else None
        chains.append(Fibre(str(muscle), points[node], np.where(node < n_nodes, node, -1), ends))
    return chains


def _bundles(place: Path, fibres: list[Fibre], centres: Floats) -> list[Bundle]:
    """Elements of every muscle, with directions interpolated between the segments of its fibres."""
    table = _table(place / "derived" / "muscle_elements.csv", ["muscle", "element"])
    bundles = list[Bundle]()
    for muscle, rows in table.groupby("muscle", sort=False):
        element = rows["element"].to_numpy(dtype=np.int64) - 1
        own = [f.position for f in fibres if f.muscle == muscle]
        bundles.append(Bundle(str(muscle), element, fibre_directions(centres[element], own)))
    return bundles


def _forces(path: Path, muscles: list[str]) -> Mapping[str, float]:
    """Largest force of every muscle [N]; that of a pair is divided equally between its sides."""
    total = {name: float(force) for name, force in (line.split() for line in _lines(path))}
    forces = dict[str, float]()
    for muscle in muscles:
        name, _, side = muscle.partition("_")
        if name not in total:
            raise TongueError(f"{path}: no force of {name}, expected one per muscle")
        forces[muscle] = total[name] / (2.0 if side else 1.0)
    return forces


def _postures(folder: Path, X: Floats) -> dict[str, Floats]:
    """Displacements of the stored shapes in the published frame [m]; none without their folder."""
    shapes = dict[str, Floats]()
    for name, file in POSTURES.items():
        if not (path := folder / f"{file}.txt").is_file():
            continue
        rows = np.array([line.split() for line in _lines(path)], dtype=np.float64)[: len(X)]
        if rows.shape != X.shape:
            raise TongueError(f"{path} has {len(rows)} rows, expected {len(X)}, one for each node")
        scale = 1.0 if name == "jaw_open_a" else 1e-3
        shapes[name] = scale * rows - COUPLED_DISPLACEMENT - X
    return shapes


def _positions(path: Path) -> Integers:
    """Numbers of nodes counted from 0."""
    return np.array([int(word) for line in _lines(path) for word in line.split()])


EXCITATION_ROUNDING: Final = 1e-6  #: largest excess of an excitation over 0-1 that is clipped
GESTURE: Final = ("GGP", "GGM", "GGA", "STY", "GH", "MH", "HG", "VERT", "TRANS", "IL", "SL")
"""Muscles of the columns of a published gesture, both sides of each."""


def read_gesture(path: str | os.PathLike[str]) -> Excitation:
    """Excitations of a published gesture of the tongue, such as ``excitations.txt``.

    The first line holds start, stop and scale of the times
    (`emgface.anatomy.jaw.series.started`), the second ``Linear 11 explicit``; rows
    are a time and the excitations of `GESTURE`, as named in the file ``0probes.art`` in the same folder.
    Values outside 0-1 by rounding are clipped. Raises TongueError if the file is absent or has
    another form, or a value is outside 0-1.
    """
    place = Path(path)
    lines = _lines(place)
    try:
        if lines[1].split() != ["Linear", str(len(GESTURE)), "explicit"]:
            raise ValueError(f"its second line is {lines[1]!r}")
        rows = np.array([[float(x) for x in line.split()] for line in lines[2:]])
        if rows.shape[1:] != (1 + len(GESTURE),):
            raise ValueError(f"its {len(rows)} rows have {rows[:1].size} numbers")
    except (IndexError, ValueError) as error:
        raise TongueError(
            f"{place} is not a gesture ({one_line(error)}): expected 'start stop scale', "
            "'Linear 11 explicit', and rows of a time and 11 excitations"
        ) from error
    values = rows[:, 1:]
    time = started(place, lines[0].split(), rows[:, 0], TongueError)
    if (
        not np.isfinite(values).all()
        or values.min() < -EXCITATION_ROUNDING
        or values.max() > 1.0 + EXCITATION_ROUNDING
    ):
        raise TongueError(
            f"{place} contains excitations from {values.min():.3g} to {values.max():.3g}, "
            "expected 0 to 1"
        )
    names = [name if name == "SL" else f"bi_{name}" for name in GESTURE]
    clipped = np.clip(values, 0.0, 1.0)
    return Excitation(time, {name: clipped[:, k] for k, name in enumerate(names)})


def _table(path: Path, columns: list[str]) -> pd.DataFrame:
    try:
        return pd.read_csv(labelled(open_text(_file(path.parent, path.name))))[columns]
    except (KeyError, ValueError) as error:
        raise TongueError(
            f"{path} cannot be read ({one_line(error)}): expected a table with the columns "
            f"{', '.join(columns)}"
        ) from error


def _lines(path: Path) -> list[str]:
    text = read_text(_file(path.parent, path.name))
    return [line for line in text.splitlines() if line.strip()]


def _file(place: Path, name: str) -> Path:
    if not (place / name).is_file():
        raise TongueError(
            f"{name} of the published tongue not found in {place}: specify the folder with tongue.node "
            "and its folder derived"
        )
    return place / name
