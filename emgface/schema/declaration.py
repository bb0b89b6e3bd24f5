"""Typed models of the declarations in data_schema, which refuse unknown entries."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

ArrayType = Literal["float64", "int8", "int32", "int64", "number", "string"]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ArrayDeclaration(_Entry):
    """One variable or coordinate of an object."""

    dims: tuple[str, ...]  #: in their order; empty for a scalar
    #: after validation; integers of any width are accepted, ``number`` accepts integers and floats
    dtype: ArrayType
    units: str | None  #: required value of the attribute ``units``; None for names
    long_name: str  #: description, written to files
    required: bool = True  #: the object must contain it
    nullable: bool = False  #: NaN is allowed; infinity never is
    range: tuple[float | None, float | None] | None = None  #: smallest and largest value
    names: tuple[str, ...] | None = None  #: allowed values of a string array
    complete: bool = False  #: the values must be exactly `names`, in that order
    pattern: str | None = None  #: regular expression that every string must match in full
    unique: bool = False  #: values must be different
    increasing: bool = False  #: values must increase
    #: the values are 0-based positions along this dim of the same object
    index_into: str | None = None
    fill: int | None = None  #: value of an index without position
    unit_length: str | None = None  #: dim along which the vectors have length one


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
