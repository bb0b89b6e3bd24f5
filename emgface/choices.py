"""Declaration of parameters, and validation of mappings as parameter models.

A parameter states its default, unit, source and note; `configure` converts a mapping to a model and
reports invalid values.
"""

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, Final, Literal, TypeVar, get_args, get_origin

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from emgface.errors import ConfigurationError

ESKES = "Eskes et al. 2017"
STAVNESS = "Stavness et al., Coupled biomechanical modeling of the face"
BLEMKER = "Blemker et al. 2005, J Biomech 38:657-665"
THIS_PACKAGE = "this package"

ModelT = TypeVar("ModelT", bound=BaseModel)


def parameter(
    default: Any,
    text: str,
    *,
    unit: str = "1",
    source: str = THIS_PACKAGE,
    note: str = "",
    **bounds: Any,
) -> Any:
    """Field of a parameter model whose description states unit, source and note.

    `text` is one sentence, `unit` an SI unit, ``"1"`` for numbers or ``"-"`` for names, `source`
    the origin of the default, `note` a remark, and `bounds` are constraints of `pydantic.Field`
    (``gt``, ``le`` ...).
    """
    description = f"{text} Unit: {unit}. Source: {source}." + (f" Note: {note}" if note else "")
    extra: dict[str, Any] = {"unit": unit, "source": source, "note": note}
    return Field(default, description=description, json_schema_extra=extra, **bounds)


def positive(default: Any, text: str, **stated: Any) -> Any:
    """Field of a number above zero; arguments as of `parameter`."""
    return parameter(default, text, gt=0, **stated)


def choice(default: Any, text: str, *, source: str = THIS_PACKAGE, note: str = "") -> Any:
    """Field with a choice of names, which has no unit; arguments as of `parameter`."""
    return parameter(default, text, unit="-", source=source, note=note)


class Parameters(BaseModel):
    """Base of all parameter models: immutable, and an unknown name is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _no_truth_for_numbers(cls, values: Any) -> Any:
        """Refuse true and false for a number, as which pydantic would read 1 and 0."""
        for name, value in values.items() if isinstance(values, Mapping) else ():
            field = cls.model_fields.get(name)
            if field is None or not _takes_number(field.annotation):
                continue
            every = value if isinstance(value, list | tuple) else (value,)
            if any(isinstance(one, bool | np.bool_) for one in every):
                raise ValueError(
                    f"{name} = {value}, expected a number instead of true or false: specify its value"
                )
        return values

    def __repr_args__(self) -> Iterator[tuple[str, Any]]:
        """Show the values that differ from their defaults."""
        fields = type(self).model_fields
        return (
            (name, getattr(self, name))
            for name, field in fields.items()
            if getattr(self, name) != field.get_default(call_default_factory=True)
        )

    def _repr_html_(self) -> str:
        """Table of all parameters with unit and source, for Jupyter."""
        table = parameter_table(self)[["parameter", "value", "default", "unit", "source"]]
        return table.to_html(index=False)


def _takes_number(annotation: Any) -> bool:
    """Return True for a type that contains numbers but no truth values."""
    kinds, types = [annotation], set[Any]()
    while kinds:
        kind = kinds.pop()
        types.add(kind if get_origin(kind) is not Literal else str)
        kinds += [] if get_origin(kind) is Literal else get_args(kind)
    return bool(types & {int, float}) and not types & {bool, Any}


def configure(model: type[ModelT], values: Mapping[str, Any], *, where: str = "") -> ModelT:
    """Validate a mapping (a table of a study file) against a parameter model.

    `where` is stated in messages, for example ``"study.toml [signals]"``. Raises ConfigurationError
    if a name is unknown (with the nearest valid one) or a value is invalid.
    """
    try:
        if hasattr(values, "data_vars"):  # a Dataset of xarray is a mapping, too
            raise TypeError
        given = dict(values)
    except (TypeError, ValueError) as error:
        raise ConfigurationError(
            f"{where or model.__name__} is {type(values).__name__}, expected a table of names and "
            "values: specify a mapping"
        ) from error
    try:
        return model.model_validate(given)
    except ValidationError as error:
        complaints = [_complaint(model, detail) for detail in error.errors()]
        place = f"{where}: " if where else ""
        raise ConfigurationError(place + "; ".join(complaints)) from error


LONGEST_VALUE: Final = 120  #: largest length of a rejected value in a message


def _complaint(model: type[BaseModel], detail: Any) -> str:
    """Clause on one rejected value."""
    path = [str(part) for part in detail["loc"]]
    name = ".".join(path) or model.__name__
    if detail["type"] == "extra_forbidden":
        valid = sorted(_names_at(model, path[:-1]))
        near = difflib.get_close_matches(path[-1], valid, n=1, cutoff=0.4)
        hint = f"did you mean '{near[0]}'?" if near else f"valid names are {', '.join(valid)}"
        return f"unknown parameter '{name}', {hint}"
    if detail["type"] == "union_tag_not_found":
        key = detail["ctx"]["discriminator"].strip("'")
        kinds = ", ".join(sorted(_tags_at(model, path, key)))
        return f"'{name}' has no '{key}', expected one of {kinds}"
    message = str(detail["msg"]).removeprefix("Value error, ")
    if detail["type"] == "value_error":
        return f"{name}: {message}"
    value = repr(detail["input"])
    value = value if len(value) <= LONGEST_VALUE else f"{value[:LONGEST_VALUE]}…"
    return f"parameter '{name}' = {value}: {message[:1].lower()}{message[1:]}"


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    """Parameter models in an annotation: itself, or in a tuple, a union, or both."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _models_at(model: type[BaseModel], path: list[str]) -> list[type[BaseModel]]:
    """Parameter models at a path, whose parts are names, numbers in a tuple and tags of a union."""
    models = [model]
    for part in path:
        fields = [m.model_fields[part].annotation for m in models if part in m.model_fields]
        if fields:
            models = [inner for field in fields for inner in _models_in(field)]
        elif not part.isdigit():
            tagged = [m for m in models if part in {f.default for f in m.model_fields.values()
                      if isinstance(f.default, str)}]  # fmt: skip
            models = tagged or models
    return models


def _names_at(model: type[BaseModel], path: list[str]) -> list[str]:
    """Names of the fields of the (nested) models at a path."""
    return [name for one in _models_at(model, path) for name in one.model_fields]


def _tags_at(model: type[BaseModel], path: list[str], key: str) -> list[str]:
    """Values of the field that distinguishes the models of a union at a path."""
    return [
        str(m.model_fields[key].default) for m in _models_at(model, path) if key in m.model_fields
    ]


def parameter_table(parameters: BaseModel) -> pd.DataFrame:
    """All parameters of a (nested) model with value, default, unit, source and note."""
    rows: list[dict[str, Any]] = []

    def walk(model: BaseModel, prefix: str) -> None:
        for name, field in type(model).model_fields.items():
            value = getattr(model, name)
            if isinstance(value, BaseModel):
                walk(value, f"{prefix}{name}.")
                continue
            extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
            rows.append(
                {
                    "parameter": prefix + name,
                    "value": value,
                    "default": field.default,
                    "unit": extra.get("unit", ""),
                    "source": extra.get("source", ""),
                    "note": extra.get("note", ""),
                }
            )

    walk(parameters, "")
    columns = ["parameter", "value", "default", "unit", "source", "note"]
    return pd.DataFrame(rows, columns=columns)
