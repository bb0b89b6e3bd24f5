"""Function that generates a model of any kind."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr

    from emgface.anatomy.head.model import Head
    from emgface.api.given import File


def build(
    kind: str,
    *,
    preset: str = "adult",
    seed: int | None = None,
    measures: Mapping[str, str] | None = None,
    resolution: str | int | None = None,
    parts: Sequence[str] | None = None,
    contacts: Sequence[str] | None = None,
    out: "File | None" = None,
) -> "xr.Dataset | Head":
    """Generate a face, jaw, tongue or head from published measures of a person.

    Parameters
    ----------
    kind : str
        "face", "jaw", "tongue" or "head".
    preset : str
        Group of people whose mean measures are used: "adult", "woman", "man" or a child.
    seed : int, optional
        Draws a random person of the group.
    measures : mapping of str to str, optional
        Measures with their units that replace those of the group, such as ``{"mouth_width": "52mm"}``.
    resolution : str or int, optional
        "coarse", "medium", "fine", or the approximate number of elements.
    parts : sequence of str, optional
        Parts of a head: "face", "jaw", "tongue", "hyoid"; default: all of them.
    contacts : sequence of str, optional
        Contact in a head, such as "lip-lip"; default: all of its parts.
    out : path-like, optional
        File to write (netCDF).

    Returns
    -------
    Dataset or Head
        Checked model in SI units, which `simulate` (faces) and ``emgface simulate`` move; a head
        contains the datasets of its parts.

    Raises
    ------
    ConfigurationError
        The kind is unknown, or has no such option.
    DataError
        The model of these measures cannot be generated.

    Examples
    --------
    >>> import emgface as ef
    >>> jaw = ef.build("jaw", preset="woman", out="jaw.nc")  # doctest: +SKIP
    """
    from typing import cast

    from emgface.api.given import target_or_none
    from emgface.models.kinds import Person, kind_named

    chosen, target = kind_named(kind), target_or_none(out)
    person = Person(
        preset=preset,
        seed=seed,
        measures=tuple(f"{name}={value}" for name, value in (measures or {}).items()),
        resolution=resolution,
        parts=None if parts is None else tuple(parts),
        contacts=None if contacts is None else tuple(contacts),
    )
    model = chosen.build(person)
    if target is not None:
        chosen.functions.write(model, target)
    return cast("Any", model)
