"""Numbers of a plan of treatment: lengths in mm and shares, with sentences on those in other units."""

from collections.abc import Mapping
from typing import Any, Final

from pydantic import model_validator

from emgface.choices import Parameters

SHORTEST_LENGTH_MM: Final = 0.1
"""Lengths of a plan that are positive and shorter are those in metres [mm]; no element is as short."""


DOUBTED: Final = {"width": 3.0, "height": 3.0}
"""Lengths of a plan that are positive and shorter may be in cm [mm]; others below 1 mm."""


NO_UNITS: Final = "lengths of a plan are numbers in mm, without a unit"


class Lengths(Parameters):
    """Base of the tables of a plan, whose lengths are in mm, and whose shares are at most 1."""

    @model_validator(mode="before")
    @classmethod
    def _plain_numbers(cls, values: Any) -> Any:
        """Refuse units and percentages, stating the number that is expected."""
        if not isinstance(values, Mapping):
            return values
        if (word := next((w for w in ("unit", "units") if w in values), "")) not in {
            "",
            *cls.model_fields,
        }:
            raise ValueError(f"{word} = {values[word]!r}: {NO_UNITS}, omit {word}")
        for name, value in values.items():
            field = cls.model_fields.get(str(name))
            if field is None or not isinstance(value, str | int | float) or isinstance(value, bool):
                continue
            text = str(value).replace("%", " %").split()
            more = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
            share = any(getattr(one, "le", None) == 1 for one in field.metadata)
            try:
                number = float(text[0])
            except (IndexError, ValueError):
                continue
            if share and (text[1:] == ["%"] or 1.0 < number <= 100.0 and len(text) == 1):
                raise ValueError(
                    f"{name} = {value!r}: expected a share from 0 to 1; if it is in percent, write "
                    f"{name} = {number / 100.0:g}"
                )
            if len(text) == 2 and more.get("unit") == "mm":
                factor = {"mm": 1.0, "cm": 10.0, "m": 1000.0}.get(text[1])
                aim = f"write {name} = {factor * number:g}" if factor else "write a number"
                raise ValueError(f"{name} = {value!r}: {NO_UNITS}, {aim}")
        return values

    def _lengths(self) -> dict[str, tuple[float, ...]]:
        """Lengths [mm] by name, those of a point together."""
        lengths: dict[str, tuple[float, ...]] = {}
        for name, field in type(self).model_fields.items():
            more, value = field.json_schema_extra, getattr(self, name)
            if value is not None and isinstance(more, dict) and more.get("unit") == "mm":
                lengths[name] = value if isinstance(value, tuple) else (value,)
        return lengths

    def doubts(self) -> tuple[str, ...]:
        """Sentences on lengths so short that they may be in cm."""
        own = (
            f"{name} = {value[0]:g} is in mm; if it is in cm, write {name} = {10 * value[0]:g}"
            for name, value in self._lengths().items()
            if len(value) == 1 and 0.0 < value[0] < DOUBTED.get(name, 1.0)
        )
        parts = (value for _, value in self if isinstance(value, Lengths))
        return (*own, *(doubt for part in parts for doubt in part.doubts()))

    @model_validator(mode="after")
    def _in_mm(self) -> "Lengths":
        for name, every in self._lengths().items():
            if 0.0 < max(abs(one) for one in every) < SHORTEST_LENGTH_MM:
                of_mm = [f"{1e3 * one:g}" for one in every]
                in_mm = of_mm[0] if len(of_mm) == 1 else f"[{', '.join(of_mm)}]"
                raise ValueError(
                    f"{name} = {getattr(self, name)}: lengths of a plan are in mm, and this one is "
                    f"shorter than {SHORTEST_LENGTH_MM:g} mm; if it is in metres, write {name} = {in_mm}"
                )
        return self
