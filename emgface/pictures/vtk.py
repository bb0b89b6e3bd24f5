"""A simulated motion for ParaView: one unstructured grid (.vtu) per frame, and their list (.pvd).

The format is that of VTK 5 and later, XML with data in base 64, as described in the VTK File
Formats document; VTK is not required.
"""

import base64
from pathlib import Path
from typing import Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from emgface.errors import DataError
from emgface.face.parts import arches_of
from emgface.face.quality import is_wedge
from emgface.files import write_text

TRIANGLE, HEXAHEDRON, WEDGE = 5, 12, 13  #: cell types of VTK
VTK_TYPES: Final[dict[str, str]] = {
    "float32": "Float32",
    "float64": "Float64",
    "int64": "Int64",
    "uint8": "UInt8",
}


def write_vtk(
    folder: str | Path,
    face: xr.Dataset,
    positions: NDArray[np.floating],
    times: NDArray[np.floating],
) -> Path:
    """Write a motion of all nodes of a face, and return the path of ``simulated.pvd``.

    `positions` (frames, nodes, 3) are in [m], `times` (frames,) in [s]. The files contain the
    elements with the displacement of their nodes from the geometry of the face [m], the bone to
    which each node is fixed and the layer of each element, and the dental arches if the face has
    them. Files of the same names are replaced. Raises DataError if the number of nodes differs from
    the face, or a file cannot be written.
    """
    folder, rest = Path(folder), face["position"].values
    if positions.shape[1:] != rest.shape or len(positions) != len(times):
        raise DataError(
            f"found positions of shape {positions.shape} at {len(times)} instants, expected "
            f"(instants, {len(rest)}, 3): record all nodes of this face"
        )
    connectivity = face["connectivity"].values
    wedge = is_wedge(connectivity)
    cells = connectivity[connectivity >= 0]
    kinds = np.where(wedge, WEDGE, HEXAHEDRON).astype(np.uint8)
    ends = np.cumsum(np.where(wedge, 6, 8))
    rows: list[tuple[float, int, str]] = []
    for k, (time, position) in enumerate(zip(times, positions, strict=True)):
        text = vtk_grid(
            position, cells, ends, kinds,
            points={"displacement": position - rest, "fixed": face["fixed"].values.astype(np.uint8)},
            cells_data={"layer": face["layer"].values.astype(np.uint8)},
        )  # fmt: skip
        name = f"simulated_{k:04d}.vtu"
        _write(folder / name, text)
        rows.append((float(time), 0, name))
    arches = arches_of(face)
    if arches:
        before = np.cumsum([0, *(len(arch.points) for arch in arches)])
        corners = [a.triangles + n for a, n in zip(arches, before, strict=False)]
        flat = np.concatenate(corners).ravel()
        text = vtk_grid(
            np.concatenate([arch.points for arch in arches]),
            flat,
            np.arange(3, len(flat) + 1, 3),
            np.full(len(flat) // 3, TRIANGLE, dtype=np.uint8),
        )
        _write(folder / "teeth.vtu", text)
        rows += [(float(time), 1, "teeth.vtu") for time in times]
    listed = "".join(
        f'<DataSet timestep="{time:.9g}" part="{part}" file={quoteattr(name)}/>\n'
        for time, part, name in rows
    )
    path = folder / "simulated.pvd"
    _write(path, _file("Collection", f"<Collection>\n{listed}</Collection>\n"))
    return path


def vtk_grid(
    position: NDArray[np.floating],
    connectivity: NDArray[np.integer],
    ends: NDArray[np.integer],
    kinds: NDArray[np.uint8],
    *,
    points: dict[str, NDArray[Any]] | None = None,
    cells_data: dict[str, NDArray[Any]] | None = None,
) -> str:
    """Text of a .vtu file: points (n, 3), nodes of all cells, end of each cell, cell types."""
    body = [f'<Piece NumberOfPoints="{len(position)}" NumberOfCells="{len(kinds)}">\n']
    for tag, arrays in (("PointData", points or {}), ("CellData", cells_data or {})):
        body += [
            f"<{tag}>\n",
            *(_array(name, values) for name, values in arrays.items()),
            f"</{tag}>\n",
        ]
    body += ["<Points>\n", _array("Points", position.astype(np.float64)), "</Points>\n<Cells>\n"]
    body += [
        _array("connectivity", connectivity.astype(np.int64)),
        _array("offsets", ends.astype(np.int64)),
        _array("types", kinds),
    ]
    body.append("</Cells>\n</Piece>\n")
    return _file(
        "UnstructuredGrid", "<UnstructuredGrid>\n" + "".join(body) + "</UnstructuredGrid>\n"
    )


def _array(name: str, values: NDArray[Any]) -> str:
    data = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
    # The number of bytes precedes the data and is encoded with them.
    text = base64.b64encode(np.uint64(len(data)).astype("<u8").tobytes() + data).decode("ascii")
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    kind = VTK_TYPES[values.dtype.name]
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{width} format="binary">{text}</DataArray>\n'


def _file(kind: str, body: str) -> str:
    return (
        '<?xml version="1.0"?>\n<!-- Simulated by emgface; lengths in metres. -->\n'
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'
        f"{body}</VTKFile>\n"
    )


def _write(path: Path, text: str) -> None:
    write_text(path, text)
