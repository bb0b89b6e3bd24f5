"""Model of a head: named parts, what holds them together, and what may touch.

A head is one Dataset (`data_schema/head_model.json`) with lists of attachments and contact pairs, and
one Dataset for each part of its own schema, stored as groups of the same netCDF file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
import xarray as xr

from emgface.anatomy.checked import CHECKS, read_model
from emgface.anatomy.jaw.exciters import exciters_of
from emgface.anatomy.jaw.model import JAW_FRAME
from emgface.anatomy.jaw.template.muscles import MUSCLE_GROUPS
from emgface.anatomy.mesh_model import integers, stacked
from emgface.errors import HeadError
from emgface.face.parts import Arch, Integers
from emgface.muscles import AXES
from emgface.run.digest import dataset_digest, text_digest
from emgface.schema.netcdf import read_netcdf, write_netcdf
from emgface.schema.validation import declared_variables, validate
from sim.indices import indices

PARTS: Final = ("face", "jaw", "tongue", "hyoid")
"""Parts by which a head is named; jaw and hyoid are bodies of one jaw_model."""
GROUP_SCHEMAS: Final = {"face": "face_model", "jaw": "jaw_model", "tongue": "tongue_model"}
"""Schema of the Dataset of each group."""
PAIRS: Final = (
    "face-jaw",
    "face-skull",
    "face-hyoid",
    "face-tongue",
    "tongue-jaw",
    "tongue-hyoid",
)
"""Attachments of nodes of a tissue to bodies, or to the elements of another tissue."""
CONTACTS: Final = {
    "lip-lip": ("face",),
    "lips-teeth": ("face",),
    "tongue-teeth": ("tongue",),
    "tongue-palate": ("tongue",),
}
"""Contact pairs, and the parts that each needs."""


FLOOR_MUSCLES: Final = {"GH": ("gh",), "MH": ("am", "pm")}
"""Muscles of the floor of the mouth that are both tissue of a tongue and lines of a jaw."""
FLOOR_LINES: Final = tuple(line for lines in FLOOR_MUSCLES.values() for line in lines)
"""The lines of these muscles, which the published coupled model lacks."""
TONGUE_GROUPS: Final = {**MUSCLE_GROUPS, "my": ("MH",), "gh": ("GH",)}
"""Groups of a jaw in which geniohyoid and mylohyoid are those of a tongue."""
FLOOR_GROUPS: Final = {
    **TONGUE_GROUPS,
    **{name: (name, *lines) for name, lines in FLOOR_MUSCLES.items()},
    "gh": ("gh", "GH"),
}
"""Groups of a jaw and a tongue that both have them, excited as one muscle each."""


HEAD_DIGEST: Final = "head_digest"
"""Attribute of a motion: digest of the head that moves."""


@dataclass(frozen=True, eq=False)
class Head:
    """A head: its lists (of schema head_model), and the Datasets of its parts by group."""

    lists: xr.Dataset
    parts: Mapping[str, xr.Dataset]

    @property
    def named(self) -> tuple[str, ...]:
        """Parts of `PARTS` that the head has."""
        return tuple(str(name) for name in self.lists["part"].values)

    def attached(self, pair: str) -> Integers:
        """Nodes of a tissue that an attachment such as "tongue-jaw" holds; none if it is absent."""
        pairs = [str(name) for name in self.lists["pair"].values]
        if pair not in pairs:
            return np.empty(0, dtype=np.int64)
        own = self.lists["attachment_pair"].values == pairs.index(pair)
        return self.lists["attachment_node"].values[own].astype(np.int64)

    def touching(self, contacts: Sequence[str]) -> "Head":
        """Head with some of its contact pairs; HeadError if it does not have one."""
        own = [str(pair) for pair in self.lists["contact"].values]
        for pair in contacts:
            if pair not in own:
                raise HeadError(
                    f"the head has no contact {pair!r}, expected some of {', '.join(own) or 'none'}"
                )
        kept = [k for k, pair in enumerate(own) if pair in contacts]
        return replace(self, lists=self.lists.isel(contact=kept))

    def shell(self, name: str) -> Arch:
        """Rigid surface "maxilla", "mandible" or "palate"; HeadError if the head has none."""
        names = [str(own) for own in self.lists["shell"].values]
        if name not in names:
            raise HeadError(f"the head has no {name}, expected one of {', '.join(names) or 'none'}")
        k = names.index(name)
        chosen = self.lists["shell_triangle"].values[self.lists["triangle_shell"].values == k]
        used, corner = np.unique(chosen, return_inverse=True)
        points = self.lists["shell_position"].values[used]
        return Arch(int(self.lists["shell_bone"].values[k]), points, corner.reshape(-1, 3))


def build_lists(
    *,
    parts: Mapping[str, xr.Dataset],
    named: Sequence[str],
    attachments: Mapping[str, Integers],
    contacts: Sequence[str],
    shells: Mapping[str, Arch],
    name: str,
    origin: str = "generated",
) -> Head:
    """Assemble a head and check it.

    Parameters
    ----------
    parts : Datasets by group.
    named : parts of `PARTS`.
    attachments : nodes by pair of `PAIRS`, of which each node belongs to at most one.
    contacts : pairs of `CONTACTS`.
    shells : rigid surfaces by name.
    name, origin : str

    Raises
    ------
    HeadError
        A contact pair or attachment is unknown or needs a part that is not named, or two muscles have
        the same name.
    SchemaError, UnitsError
        A Dataset does not follow its declaration.
    """
    for pair in contacts:
        if pair not in CONTACTS:
            raise HeadError(f"contact {pair!r}, expected one of {', '.join(CONTACTS)}")
        absent = [part for part in CONTACTS[pair] if part not in named]
        if absent:
            raise HeadError(f"contact {pair} needs the {absent[0]}, expected it among the parts")
    for pair in attachments:
        tissue, _, other = pair.partition("-")
        if pair not in PAIRS or tissue not in parts or (other == "tongue" and other not in parts):
            raise HeadError(
                f"attachment {pair!r}, expected one of {', '.join(PAIRS)} with its "
                "tissues among the parts"
            )
    muscles = [str(m) for part in parts.values() for m in part["muscle"].values]
    twice = sorted({m for m in muscles if muscles.count(m) > 1})
    if twice:
        raise HeadError(f"muscle {twice[0]} belongs to two parts, expected different names")
    groups = MUSCLE_GROUPS if "tongue" not in named else TONGUE_GROUPS
    if "tongue" in named and any(muscle[:-2] in FLOOR_LINES for muscle in muscles):
        groups = FLOOR_GROUPS
    exciters = exciters_of(muscles, groups)
    gain = np.array([[own.get(m, 0.0) for m in muscles] for own in exciters.values()])
    attachments = {
        pair: indices(
            f"the attachment {pair}",
            "node",
            nodes,
            parts[pair.partition("-")[0]].sizes["node"],
            error=HeadError,
        )
        for pair, nodes in attachments.items()
    }
    sizes = [len(nodes) for nodes in attachments.values()]
    first = np.cumsum([0, *(len(s.points) for s in shells.values())])
    triangles = [s.triangles + k for s, k in zip(shells.values(), first, strict=False)]
    variables = declared_variables(
        "head_model",
        axis=AXES,
        part=list(named),
        pair=list(attachments),
        contact=list(contacts),
        shell=list(shells),
        muscle=muscles,
        exciter=list(exciters),
        attachment_pair=integers(np.repeat(np.arange(len(sizes)), sizes)),
        attachment_node=integers(np.concatenate([np.empty(0), *attachments.values()])),
        shell_bone=integers([s.bone for s in shells.values()]),
        shell_position=stacked([s.points for s in shells.values()]),
        shell_triangle=integers(np.concatenate([np.empty((0, 3)), *triangles])),
        triangle_shell=integers(np.repeat(np.arange(len(shells)), [len(t) for t in triangles])),
        exciter_gain=gain,
    )
    lists = xr.Dataset(variables, attrs={"name": name, "origin": origin, "frame": JAW_FRAME})
    checked = {group: CHECKS[GROUP_SCHEMAS[group]](part) for group, part in parts.items()}
    return Head(validate(lists, "head_model"), checked)


def write_head(head: Head, path: str | Path) -> Path:
    """Write a head with its parts as groups of one netCDF file; errors as of `write_netcdf`."""
    parts = {group: (part, GROUP_SCHEMAS[group]) for group, part in head.parts.items()}
    return write_netcdf(head.lists, path, "head_model", groups=parts)


def head_digest(parts: Mapping[str, xr.Dataset]) -> str:
    """Digest of the parts of a head, by which its motions are recognised."""
    return text_digest(
        " ".join(f"{group} {dataset_digest(parts[group])}" for group in sorted(parts))
    )


def require_own_motion(head: Head, motion: xr.Dataset) -> None:
    """Raise HeadError if a motion states the digest of another head, or has other numbers of nodes."""
    own, other = head_digest(head.parts), str(motion.attrs.get(HEAD_DIGEST, ""))
    tissues = [name for name in ("face", "tongue") if name in head.parts]
    nodes = sum(head.parts[name].sizes["node"] for name in tissues)
    if (other and other != own) or motion.sizes.get("node", nodes) != nodes:
        raise HeadError(
            f"the motion has {motion.sizes.get('node', 0)} nodes and is of the head "
            f"{str(motion.attrs.get('head', 'unnamed'))!r} with digest {other[:8] or 'not stated'}, "
            f"found the head {str(head.lists.attrs.get('name', ''))!r} with {nodes} nodes and digest "
            f"{own[:8]}: specify the head that was simulated"
        )


def require_face_and_jaw(head: Head) -> None:
    """Raise HeadError unless a head has both."""
    for part in ("face", "jaw"):
        if part not in head.named:
            raise HeadError(
                f"the head has no {part}, expected face and jaw: emgface build head --parts face,jaw"
            )


def read_head(path: str | Path) -> Head:
    """Read a head; errors as of `emgface.schema.netcdf.read_netcdf`."""
    lists = read_netcdf(path, "head_model")
    return Head(lists, read_parts(path, lists["part"].values.tolist()))


def read_lists(path: str | Path) -> tuple[xr.Dataset, Mapping[str, xr.Dataset]]:
    """Read the lists of a head and its parts, as `read_head`."""
    head = read_head(path)
    return head.lists, head.parts


def read_parts(path: str | Path, named: Sequence[str]) -> dict[str, xr.Dataset]:
    """Read the groups of named parts."""
    groups = dict.fromkeys("jaw" if name == "hyoid" else name for name in named)
    return {group: read_model(path, GROUP_SCHEMAS[group], group=group) for group in groups}
