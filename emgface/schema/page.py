"""The page that documents every object of the package, made from its declarations."""

import json
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from emgface.schema.declaration import ArrayDeclaration, AttributeDeclaration, ObjectDeclaration
from emgface.schema.migration import MIGRATIONS
from emgface.schema.validation import declaration, kinds

HEAD = """# Objects and their declarations

This page is made by `emgface data schema` from the files in `data_schema/`; do not edit it.

Every object is an xarray Dataset (the study apart, which is a TOML file), checked whenever it
enters or leaves a stage. Numbers are in SI units; the attribute `units` of every array names them.
A question mark marks what may be absent. Ranges include their ends; NaN stands for a value that is
not there, and is an error where the table does not allow it.
"""


def schema_page() -> str:
    """Write the page.

    Returns
    -------
    str
        Markdown: one section per kind of dataset, with every coordinate, variable and attribute,
        its dims, unit and range; then the parameters of a study.
    """
    sections = [_section(declaration(kind)) for kind in kinds()]
    return "\n".join([HEAD, *sections, _study()])


def study_schema() -> dict[str, Any]:
    """Return the JSON Schema of a study file, as ``data_schema/study.json`` holds it.

    Returns
    -------
    dict
        JSON Schema (draft 2020-12) that editors of TOML understand; ``version`` is that of the
        form.
    """
    from emgface.study.configuration import STUDY_VERSION, StudyConfiguration

    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "version": STUDY_VERSION,
        **StudyConfiguration.model_json_schema(),
    }


def study_schema_text() -> str:
    """Return `study_schema` as the text of a file."""
    return json.dumps(study_schema(), indent=1, ensure_ascii=False) + "\n"


def _section(declared: ObjectDeclaration) -> str:
    older = [str(version) for kind, version in MIGRATIONS if kind == declared.kind]
    lines = [f"## {declared.kind}", "", f"{declared.title}. Version {declared.version}"]
    lines[-1] += f"; version {', '.join(older)} is migrated." if older else "."
    if declared.any_of:
        lines += ["", f"At least one of {_code(declared.any_of)} must be there."]
    if not declared.extra_variables:
        lines += ["", "No other variables are allowed."]
    arrays = {"Coordinate": declared.coords, "Variable": declared.variables}
    for title, group in arrays.items():
        lines += [
            "",
            f"| {title} | Dims | Type | Unit | Range | Meaning |",
            "|---|---|---|---|---|---|",
        ]
        lines += [_array(name, array) for name, array in group.items()]
    if declared.attrs:
        lines += ["", "| Attribute | Type | Values | Meaning |", "|---|---|---|---|"]
        lines += [_attribute(name, one) for name, one in declared.attrs.items()]
    if declared.study is not None:
        lines += ["", f"A study demands besides: {declared.study.meaning}"]
        if declared.study.required:
            lines[-1] += f"; {_code(declared.study.required)}"
        lines[-1] += "."
        for name, names in declared.study.names.items():
            if names != declared.coords[name].names:
                lines += ["", f"`{name}` holds all of {_code(names)}."]
    return "\n".join([*lines, ""])


def _array(name: str, array: ArrayDeclaration) -> str:
    meaning = [array.long_name]
    if array.names:
        values = _code(array.names)
        meaning.append(
            f"exactly {values}, in this order" if array.complete else f"some of {values}"
        )
    if array.index_into:
        fill = "" if array.fill is None else f"; {array.fill} points nowhere"
        meaning.append(f"0-based position along `{array.index_into}`{fill}")
    if array.unique:
        meaning.append("no value twice")
    if array.increasing:
        meaning.append("increasing")
    if array.unit_length:
        meaning.append(f"length one along `{array.unit_length}`")
    bounds = _range(array.range)
    if array.pattern:
        bounds = f"`{array.pattern}`"
    if array.nullable:
        bounds = f"{bounds}, NaN".removeprefix(", ")
    dims = f"({', '.join(array.dims)})"
    cells = (
        f"`{name}`{'' if array.required else ' ?'}", dims, array.dtype, array.units or "-",
        bounds or "-", "; ".join(meaning),
    )  # fmt: skip
    return _row(cells)


def _attribute(name: str, one: AttributeDeclaration) -> str:
    values = _code(one.values) if one.values else _range(one.range)
    return _row((f"`{name}`{'' if one.required else ' ?'}", one.dtype, values or "-", one.meaning))


def _study() -> str:
    from emgface.study.configuration import STUDY_VERSION, StudyConfiguration

    lines = [
        "## study",
        "",
        f"All choices of a study, as `study.toml` holds them. Version {STUDY_VERSION}. The JSON "
        "Schema is `data_schema/study.json`.",
        "",
        "| Parameter | Default | Unit | Meaning | Source | Note |",
        "|---|---|---|---|---|---|",
    ]
    return "\n".join([*lines, *_parameters(StudyConfiguration, ""), ""])


def _parameters(model: type[BaseModel], prefix: str) -> list[str]:
    """Rows of a parameter model and of those within it."""
    rows: list[str] = []
    for name, field in model.model_fields.items():
        kinds_ = (field.annotation, *get_args(field.annotation))
        nested = [k for k in kinds_ if isinstance(k, type) and issubclass(k, BaseModel)]
        if nested:
            many = get_origin(field.annotation) is tuple
            rows += _parameters(nested[0], f"{prefix}{name}{'[]' if many else ''}.")
            continue
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        default = "" if field.default is None else _plain(field.default)
        meaning = (field.description or "").partition(" Unit: ")[0]
        told = (str(extra.get(key, "")) for key in ("unit", "source", "note"))
        unit, source, note = told
        cells = (f"`{prefix}{name}`", default, unit, meaning, source, note)
        rows.append(_row(tuple(cell or "-" for cell in cells)))
    return rows


def _plain(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:g}"
    return ", ".join(map(_plain, value)) if isinstance(value, tuple) else str(value)


def _range(bounds: tuple[float | None, float | None] | None) -> str:
    if bounds is None:
        return ""
    low, high = bounds
    if low is None:
        return f"at most {high:g}" if high is not None else ""
    return f"at least {low:g}" if high is None else f"{low:g} to {high:g}"


def _code(names: tuple[str, ...]) -> str:
    return ", ".join(f"`{name}`" for name in names)


def _row(cells: tuple[str, ...]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in cells) + " |"
