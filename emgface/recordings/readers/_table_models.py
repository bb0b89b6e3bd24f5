"""Description of a table or array in a sidecar."""

import codecs
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from emgface.choices import Parameters
from emgface.recordings.readers._arrays import SUFFIXES as ARRAYS


class Table(Parameters):
    """Description of one CSV file, or one array of a MATLAB or HDF5 file.

    Attributes
    ----------
    file : str
        Name, relative to the sidecar.
    unit : str
        Unit of the values.
    rate : float or None
        Sampling rate [Hz]; the alternative to a column of instants.
    time, time_unit : str or None, str
        Column (or variable) of instants and its unit.
    delimiter, decimal : str
        Two different characters, ``;`` and ``,`` in some countries.
    encoding : str
        Encoding of the text: ``utf-8``, ``latin-1``, ``utf-16`` or another one supported by Python. A
        byte order mark at the start of the file takes precedence.
    columns : list of str or None
        Labels of the columns, if the file contains none.
    skip_rows : int
        Number of lines before the labels or numbers of a table.
    variable, columns_variable : str or None
        Array of a MATLAB or HDF5 file, and variable of its labels.
    dims : tuple of str
        Dims of that array, in its order: time and channel, or time, marker and axis.
    step, zero : float
        Value of one count, and the count of zero.
    """

    file: str
    unit: str
    rate: float | None = Field(default=None, gt=0)
    time: str | None = None
    time_unit: str = "s"
    delimiter: str = ","
    decimal: Literal[".", ","] = "."
    encoding: str = "utf-8"
    columns: tuple[str, ...] | None = None
    skip_rows: int = Field(default=0, ge=0)
    variable: str | None = None
    columns_variable: str | None = None
    dims: tuple[Literal["time", "channel", "marker", "axis"], ...] = ("time", "channel")
    step: float = 1.0
    zero: float = 0.0

    @model_validator(mode="after")
    def _clocked(self) -> "Table":
        if (self.rate is None) == (self.time is None):
            raise ValueError(
                f"{self.file} requires either rate, in Hz, or time, the column of the sampling times"
            )
        held = Path(self.file).suffix.lower() in ARRAYS
        if held != (self.variable is not None):
            raise ValueError(
                f"{self.file} requires variable, the name of the array in the file"
                if held
                else f"{self.file} contains no variables; expected one of {', '.join(ARRAYS)}"
            )
        if self.delimiter == self.decimal:
            raise ValueError(
                f"delimiter and decimal are both {self.decimal!r}, so that numbers cannot be "
                "distinguished from cells: expected delimiter = ';' or decimal = '.'"
            )
        try:
            codecs.lookup(self.encoding)
        except LookupError:
            raise ValueError(
                f"encoding = {self.encoding!r} is unknown, expected for example 'utf-8', 'latin-1' "
                "or 'utf-16'"
            ) from None
        if sorted(self.dims) not in (["channel", "time"], ["axis", "marker", "time"]):
            raise ValueError("dims are time and channel, or time, marker and axis, in some order")
        return self


class EmgTable(Table):
    """Description of the CSV file of EMG, with the names of its columns."""

    channels: dict[str, str] | None = None


class PositionTable(Table):
    """Description of the CSV file of markers, with the suffixes of the columns of a marker."""

    markers: dict[str, str] | None = None
    axes: tuple[str, str, str] = ("_x", "_y", "_z")
