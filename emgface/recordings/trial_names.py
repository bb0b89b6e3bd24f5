"""Trials identified by the names of their files, such as ``V1_A_3.c3d``."""

import re
from pathlib import Path
from typing import Any, Final

from emgface.errors import ConfigurationError

TRIAL_FIELDS: Final = ("volunteer", "instruction", "repetition")
"""Names in braces that a pattern may contain, and that identify a trial."""
_FORMS: Final = {"volunteer": "[^/]+", "instruction": "[^/]+?", "repetition": r"\d+"}
_FIELD: Final = re.compile(r"\{([^{}]*)\}")


def is_pattern(text: str | Path) -> bool:
    """Return True for a pattern of file names, which contains the name of a field in braces.

    Examples
    --------
    >>> is_pattern("{volunteer}_{instruction}_{repetition}.c3d"), is_pattern("mapping.toml")
    (True, False)
    """
    return any(f"{{{name}}}" in str(text) for name in TRIAL_FIELDS)


def check_pattern(pattern: str) -> str:
    """Return a pattern; ConfigurationError if it contains an unknown field, or one twice."""
    names = _FIELD.findall(pattern)
    wrong = [name for name in names if name not in TRIAL_FIELDS or names.count(name) > 1]
    if wrong or not names or "{" in _FIELD.sub("", pattern) or "}" in _FIELD.sub("", pattern):
        raise ConfigurationError(
            f"names = {pattern!r} contains {wrong[0] if wrong else 'no field'!r}; expected each of "
            "{volunteer}, {instruction} and {repetition} at most once, such as "
            "'{volunteer}_{instruction}_{repetition}.c3d'"
        )
    return pattern


def trial_in_name(pattern: str, path: Path) -> dict[str, Any]:
    """Return what the name of a file states about its trial; nothing if it does not fit.

    The pattern may contain folders: as many parts of the path are compared as it has. A field is
    a text without ``/``, that of the volunteer as long as possible, the repetition a number. Case
    is ignored. A pattern without the suffix of a file fits files of any suffix.

    Examples
    --------
    >>> trial_in_name("{volunteer}/{instruction}_{repetition}.c3d", Path("data/V1/A_03.C3D"))
    {'volunteer': 'V1', 'instruction': 'A', 'repetition': 3}
    """
    parts = [part for part in Path(pattern).parts if part not in ("/", ".")]
    # A pattern of a study file is relative to its folder, which precedes the first field.
    first = next((k for k, part in enumerate(parts) if "{" in part), 0)
    parts = parts[first:]
    text = "/".join(path.parts[-len(parts) :])
    suffix = Path(parts[-1]).suffix if parts else ""
    if not suffix or "{" in suffix:
        text = text.removesuffix(path.suffix)
    form = ""
    for k, piece in enumerate(_FIELD.split("/".join(parts))):
        if k % 2 == 0:
            form += re.escape(piece)
        else:
            form += rf"(?P<{piece}>{_FORMS[piece]})"
    match = re.fullmatch(form, text, re.IGNORECASE)
    if match is None:
        return {}
    result: dict[str, Any] = dict(match.groupdict())
    if "repetition" in result:
        result["repetition"] = int(result["repetition"])
    return result
