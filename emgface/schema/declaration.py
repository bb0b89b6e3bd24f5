"""Typed models of the declarations in data_schema, which refuse unknown entries."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

ArrayType = Literal["float64", "int8", "int32", "int64", "number", "string"]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ArrayDeclaration(_Entry):
    """One variable or coordinate of an object.

    Attributes
    ----------
    dims : tuple of str
        Dims in their order; empty for a scalar.
    dtype : str
        Type after validation; integers of any width are accepted, ``number`` takes integers
        and floats.
    units : str or None
        Unit that the attribute ``units`` must name; None where a unit has no meaning (names).
    long_name : str
        Description, written to files.
    required : bool
        Whether the object must have it.
    nullable : bool
        Whether NaN is allowed; an infinity never is.
    range : tuple of (float or None, float or None) or None
        Smallest and largest value.
    names : tuple of str or None
        Values a string array may take.
    complete : bool
        The values must be exactly `names`, in that order.
    pattern : str or None
        Regular expression that every string must match in full.
    unique, increasing : bool
        No value twice; every value above the one before.
    index_into : str or None
        The values are 0-based positions along this dim of the same object.
    fill : int or None
        Value of an index that points nowhere.
    unit_length : str or None
        Dim along which the vectors have length one.
    """

    dims: tuple[str, ...]
    dtype: ArrayType
    units: str | None
    long_name: str
    required: bool = True
    nullable: bool = False
    range: tuple[float | None, float | None] | None = None
    names: tuple[str, ...] | None = None
    complete: bool = False
    pattern: str | None = None
    unique: bool = False
    increasing: bool = False
    index_into: str | None = None
    fill: int | None = None
    unit_length: str | None = None


class AttributeDeclaration(_Entry):
    """One attribute of an object: type, allowed values or range, and meaning."""

    dtype: Literal["string", "integer", "number", "any"]
    meaning: str
    required: bool = False
    values: tuple[str, ...] | None = None
    range: tuple[float | None, float | None] | None = None


class StudyDeclaration(_Entry):
    """Additional requirements of a study.

    Attributes
    ----------
    required : tuple of str
        Variables and attributes that may not be absent.
    names : dict of str to tuple of str
        Values that each coordinate must hold, all of them and in any order.
    meaning : str
        Description of the requirement.
    """

    required: tuple[str, ...] = ()
    names: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    meaning: str


class ObjectDeclaration(_Entry):
    """One kind of dataset: the content of one file in data_schema.

    Where ``further_dims``, dims that are not declared may stand before those of every variable.
    """

    kind: str
    version: int
    title: str
    any_of: tuple[str, ...] = ()
    extra_variables: bool = True
    further_dims: bool = False
    coords: dict[str, ArrayDeclaration]
    variables: dict[str, ArrayDeclaration]
    attrs: dict[str, AttributeDeclaration]
    study: StudyDeclaration | None = None

    def arrays(self) -> dict[str, ArrayDeclaration]:
        """Coordinates and variables together."""
        return {**self.coords, **self.variables}
