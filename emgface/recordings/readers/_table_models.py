"""Description of a table or array in a sidecar."""

import codecs
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from emgface.choices import Parameters
from emgface.recordings.readers._arrays import ARRAY_SUFFIXES


class Table(Parameters):
    """Description of one CSV file, or one array of a MATLAB or HDF5 file."""

    file: str  #: name, relative to the sidecar
    unit: str  #: unit of the values
    #: sampling rate [Hz]; the alternative to a column of instants
    rate: float | None = Field(default=None, gt=0)
    time: str | None = None  #: column (or variable) of instants
    time_unit: str = "s"  #: unit of the instants
    #: program whose export the file is, as `emgface describe` names it; the file then states the
    #: rate and most units itself, `unit` is that of signals without one
    layout: str | None = None
    delimiter: str = ","  #: differs from `decimal`, and is often ``;`` if that is ``,``
    decimal: Literal[".", ","] = "."
    #: ``utf-8``, ``latin-1``, ``utf-16`` or another one supported by Python; a byte order mark at
    #: the start of the file takes precedence
    encoding: str = "utf-8"
    columns: tuple[str, ...] | None = None  #: labels of the columns, if the file contains none
    skip_rows: int = Field(default=0, ge=0)  #: lines before the labels or numbers of a table
    variable: str | None = None  #: array of a MATLAB or HDF5 file
    columns_variable: str | None = None  #: variable of its labels
    #: dims of that array, in its order: time and channel, or time, marker and axis
    dims: tuple[Literal["time", "channel", "marker", "axis"], ...] = ("time", "channel")
    #: columns (or variables) that state of every sample whether it is good: the meaning of 1 or true,
    #: or ``ignored``; labels such as ``valid``, ``ZYG_L_ok`` or ``artifact`` need no entry
    flags: dict[str, Literal["good", "bad", "ignored"]] = Field(default_factory=dict)
    step: float = 1.0  #: value of one count, negative if the sign is reversed
    zero: float = 0.0  #: count of zero

    @model_validator(mode="after")
    def _clocked(self) -> "Table":
        if (self.rate is None) == (self.time is None):
            raise ValueError(
                f"{self.file} requires either rate, in Hz, or time, the column of the sampling times"
            )
        is_array = Path(self.file).suffix.lower() in ARRAY_SUFFIXES
        if is_array != (self.variable is not None):
            raise ValueError(
                f"{self.file} requires variable, the name of the array in the file"
                if is_array
                else f"{self.file} contains no variables; expected one of {', '.join(ARRAY_SUFFIXES)}"
            )
        if self.step == 0.0:
            raise ValueError(
                "step is 0, so that every sample would be 0, expected the value of one count"
            )
        twice = [name for name in self.columns or () if (self.columns or ()).count(name) > 1]
        if twice:
            raise ValueError(
                f"columns lists {twice[0]!r} more than once, expected a different label for each column"
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
    units: dict[str, str] = Field(default_factory=dict)  #: units of columns that are not in `unit`


class PositionTable(Table):
    """Description of the CSV file of markers, with the suffixes of the columns of a marker."""

    markers: dict[str, str] | None = None
    axes: tuple[str, str, str] = ("_x", "_y", "_z")
