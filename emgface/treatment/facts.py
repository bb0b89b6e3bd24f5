"""Words of a step of a plan and of its report: names, and numbers with their units."""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from pydantic import BaseModel

SHOWN_UNITS: Final = {"mm3": "mm³", "mm2": "mm²", "mm": "mm", "N": "N", "Pa": "Pa"}
"""Unit as it is shown, by the last part of the name of a value."""
NOT_SHOWN: Final = ("step", "kind", "doubts")  #: names of a report that are stated separately

Facts = list[tuple[str, str]]


def quantity(value: float, unit: str = "") -> str:
    """Three digits of a number with its unit, with a space between thousands."""
    text = f"{value:.3g}"
    if abs(value) >= 1e3:
        text = f"{float(text):,.0f}".replace(",", "\N{NO-BREAK SPACE}")
    return f"{text}\N{NO-BREAK SPACE}{unit}" if unit else text


def _text(value: Any, unit: str = "") -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return quantity(value, unit)
    if isinstance(value, list | tuple):
        return (
            " ".join(_text(one) for one in value) + (f" {unit}" if unit else "")
            if value
            else "none"
        )
    return str(value) or "none"


def facts_of_report(report: Mapping[str, Any]) -> Facts:
    """Names and values of the report of a step, whose names end in their units."""
    facts: Facts = []
    for name, value in report.items():
        words, _, last = name.rpartition("_")
        unit = SHOWN_UNITS.get(last, "")
        if name not in NOT_SHOWN:
            facts.append(((words if unit else name).replace("_", " "), _text(value, unit)))
    return facts


def facts_of_step(step: BaseModel) -> Facts:
    """Names and values of the parameters of a step, without those that are not specified."""
    return [(name.replace("_", " "), text) for name, text in _parameters(step, "")]


def _parameters(model: BaseModel, prefix: str) -> Iterator[tuple[str, str]]:
    for name, field in type(model).model_fields.items():
        value, more = getattr(model, name), field.json_schema_extra
        if isinstance(value, BaseModel):
            yield from _parameters(value, f"{prefix}{name} ")
        elif value is not None and value != () and name not in NOT_SHOWN:
            unit = str(more.get("unit", "")) if isinstance(more, dict) else ""
            yield f"{prefix}{name}", _text(value, "" if unit in ("1", "-") else unit)
