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
        Type after validation; integers of any width are accepted, ``number`` accepts integers
        and floats.
    units : str or None
        Required value of the attribute ``units``; None for names.
    long_name : str
        Description, written to files.
    required : bool
        True if the object must contain it.
    nullable : bool
        True if NaN is allowed; infinity never is.
    range : tuple of (float or None, float or None) or None
        Smallest and largest value.
    names : tuple of str or None
        Allowed values of a string array.
    complete : bool
        The values must be exactly `names`, in that order.
    pattern : str or None
        Regular expression that every string must match in full.
    unique, increasing : bool
        Values must be different, or increase.
    index_into : str or None
        The values are 0-based positions along this dim of the same object.
    fill : int or None
        Value of an index without position.
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

    `required` are variables and attributes, `names` the values that each coordinate must contain,
    in any order, and `meaning` describes the requirement.
    """

    required: tuple[str, ...] = ()
    names: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    meaning: str


class ObjectDeclaration(_Entry):
    """One kind of dataset: the content of one file in data_schema.

    With ``further_dims``, undeclared dims may precede those of every variable.
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
