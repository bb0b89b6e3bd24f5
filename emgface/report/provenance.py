"""Provenance in a report: the software that computed the cube and that wrote the report."""

import json
import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import xarray as xr

from analysis.axes import reference_cube
from analysis.cube import TRIAL_DIMS
from analysis.tables import Column, Table, origin_of, recordings
from emgface import __version__
from emgface.errors import listed
from emgface.report.results import Results
from emgface.run.digest import file_digest
from emgface.run.provenance import now

WRITERS = ("numpy", "scipy", "xarray", "statsmodels", "matplotlib")
"""Packages on which the statistics and pictures of a report depend."""


def sources(results: Results) -> list[tuple[str, str]]:
    """List the title and the sources of the cube, with digests, from its attributes."""
    attrs = results.cube.attrs
    absent = "not recorded"
    rows = [
        ("study", str(attrs.get("name", "unnamed"))),
        ("title", str(attrs.get("title", absent))),
        ("recordings", origin_of(results.cube)),
        ("cube, SHA-256", file_digest(results.folder / "cube.nc")),
        ("last result computed", str(attrs.get("date_created", absent))),
        ("face", str(attrs.get("face", "unnamed"))),
        ("origin of the face", str(attrs.get("face_origin", absent))),
        ("digest of the face", str(attrs.get("face_digest", absent))),
    ]
    if results.laboratory is not None:
        source = str(results.laboratory.face.attrs.get("source", ""))
        now_read = results.laboratory.face_digest
        if "face_digest" in attrs and now_read != attrs["face_digest"]:
            rows.append(("present digest of the face", f"{now_read}: the face has been changed"))
        if source:
            rows.append(("source of the face", source))
    return rows + [("history", line) for line in str(attrs.get("history", "")).splitlines()]


def environments(cube: xr.Dataset) -> list[tuple[str, list[tuple[str, str]]]]:
    """List the environments (name, entries) that computed the cube, from its attribute."""
    stored: dict[str, Any] = json.loads(str(cube.attrs.get("environments", "{}")))
    listed: list[tuple[str, list[tuple[str, str]]]] = []
    for name, one in stored.items():
        rows: list[tuple[str, str]] = []
        for key, value in one.items():
            if isinstance(value, dict):
                pairs: dict[str, Any] = value  # pyright: ignore[reportUnknownVariableType]
                text = ", ".join(f"{k} {v}" for k, v in pairs.items()) or "none"
            else:
                text = str(value)
            rows.append((PROVENANCE_WORDS.get(str(key)) or str(key), text))
        listed.append((str(name), rows))
    return listed


PROVENANCE_WORDS = {
    "blas": "BLAS of numpy",
    "code": "digest of the code",
    "python": "Python",
    "settings": "environment variables",
}


def mixture(cube: xr.Dataset) -> Table | None:
    """List the trials by environment, one row each; None unless there are several environments."""
    if "computed_with" not in cube:
        return None
    base = reference_cube(cube)
    which = base["computed_with"].transpose(*TRIAL_DIMS)
    date = base["computed"].transpose(*TRIAL_DIMS)
    known = {text for text in which.values.flat if text}
    if len(known) < 2 and not any(" " in text for text in known):
        return None
    rows = tuple(
        (*(base[dim].values[k] for dim, k in zip(TRIAL_DIMS, index, strict=True)),
         str(date.values[index]), str(which.values[index]))
        for index in np.ndindex(*which.shape)
        if which.values[index]
    )  # fmt: skip
    columns = tuple(Column(name) for name in (*TRIAL_DIMS, "computed", "environments"))
    origin = origin_of(cube)
    title = f"trials by computing environment, {recordings(origin)}"
    note = "Two environments in one row: the trial began in one environment and resumed in another."
    return Table(title, columns, rows, origin, note)


def warning(cube: xr.Dataset) -> str:
    """Sentence on a mixed or unknown provenance of a cube; empty if it is uniform and known."""
    entries = environments(cube)
    if not entries:
        return (
            "The environment that computed this cube is not recorded, because an older version "
            "wrote it."
        )
    if len(entries) == 1:
        return ""
    versions = {dict(rows).get("emgface", "") for _, rows in entries}
    what = f"versions {' and '.join(sorted(versions))}" if len(versions) > 1 else "one version"
    return (
        f"The trials of this cube were computed in {len(entries)} different environments "
        f"(emgface of {what}); they are listed under provenance. Run the study in a new "
        "folder to compute all trials in one environment."
    )


def writer() -> list[tuple[str, str]]:
    """List the environment that writes the report, which may differ from that of the cube."""
    rows = [("written", now()), ("emgface", __version__), ("Python", platform.python_version())]
    for name in WRITERS:
        try:
            rows.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return [*rows, ("machine", f"{platform.system()} {platform.machine()}")]


def repeated(cube: xr.Dataset) -> list[str]:
    """Sentences on recordings that a cube contains as several trials, as when cubes were joined."""
    same: dict[str, list[str]] = {}
    for label, _, digest in recordings_in(cube):
        same.setdefault(digest, []).append(label)
    return [
        f"The trials {listed(labels)} have the same recording, which counts {len(labels)} times in all "
        "statistics: remove the copies from the cube."
        for labels in same.values()
        if len(labels) > 1
    ]


def recording_rows(results: Results) -> list[tuple[str, str, str]]:
    """List the recordings that were scored: trial, file and digest of its content."""
    return recordings_in(results.base)


def recordings_in(cube: xr.Dataset) -> list[tuple[str, str, str]]:
    """List the recordings of a cube: trial, file and digest of its content."""
    if "recording_digest" not in cube:
        return []
    dims = ("volunteer", "instruction", "repetition")
    digest = cube["recording_digest"].transpose(*dims).values
    file = cube["recording"].transpose(*dims).values
    rows: list[tuple[str, str, str]] = []
    for index in np.ndindex(*digest.shape):
        if digest[index]:
            labels = (cube[dim].values[k] for dim, k in zip(dims, index, strict=True))
            rows.append((" ".join(map(str, labels)), str(file[index]), str(digest[index])))
    return rows
