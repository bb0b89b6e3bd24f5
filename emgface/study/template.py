"""Commented study.toml, generated from the descriptions of the parameters."""

import json
import textwrap
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from emgface.study.configuration import StudyConfiguration


def study_template(study: StudyConfiguration | None = None) -> str:
    """TOML text of a study file with all parameters (default: their defaults) and descriptions.

    Parameters and tables without a value are comments.
    """
    head = (
        "# A study: every parameter with its default, unit and source.\n"
        "# Lines with defaults may be removed.\n"
    )
    return head + "\n".join(_table(study or StudyConfiguration(), "")) + "\n"


def _table(model: BaseModel, name: str) -> list[str]:
    lines: list[str] = []
    fields = type(model).model_fields
    rows_of = {key: _row(model, key) for key in fields if _row(model, key) is not None}
    tables = {key: _nested(model, key) for key in fields if _nested(model, key) is not None}
    if name:
        lines += [f"[{name}]"]
    for key, field in fields.items():
        if key in tables or key in rows_of:
            continue
        value = getattr(model, key)
        comment = textwrap.wrap(field.description or "", 96)
        lines += [f"# {line}" for line in comment]
        lines += [f"# {key} =" if value is None else f"{key} = {_value(value)}", ""]
    for key, nested in tables.items():
        path = f"{name}.{key}" if name else key
        title = textwrap.wrap(fields[key].description or "", 96)
        rows = _table(nested, path)
        if getattr(model, key) is None:
            rows = [row if row.startswith("#") or not row else f"# {row}" for row in rows]
        lines += ["", *(f"# {line}" for line in title), *rows]
    for key, empty in rows_of.items():
        lines += ["", *(f"# {line}" for line in textwrap.wrap(fields[key].description or "", 96))]
        given = getattr(model, key)
        for row in given or (empty,):
            rows = [f"[[{name}.{key}]]" if name else f"[[{key}]]", *_table(row, "")]
            lines += rows if given else [f"# {r}" if r and r[0] != "#" else r for r in rows]
    return lines


def _row(model: BaseModel, key: str) -> Any:
    """Defaults of one row of an array of tables; None for other fields."""
    annotation = type(model).model_fields[key].annotation
    first = (*get_args(annotation), None)[0] if get_origin(annotation) is tuple else None
    return first() if isinstance(first, type) and issubclass(first, BaseModel) else None


def _nested(model: BaseModel, key: str) -> Any:
    """Table of a name: its value, or the defaults of an optional one."""
    if isinstance(value := getattr(model, key), BaseModel):
        return value
    if _row(model, key) is not None:
        return None
    kinds = get_args(type(model).model_fields[key].annotation)
    return next((k() for k in kinds if isinstance(k, type) and issubclass(k, BaseModel)), None)


def _value(value: Any) -> str:
    if isinstance(value, Path):
        value = value.as_posix()
    if isinstance(value, dict):
        return "{" + ", ".join(f"{name} = {_value(one)}" for name, one in value.items()) + "}"
    return json.dumps(list(value) if isinstance(value, tuple) else value)
