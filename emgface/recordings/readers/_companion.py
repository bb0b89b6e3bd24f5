"""Files that another file names, kept within the folder of that file."""

from pathlib import Path, PureWindowsPath

from emgface.errors import DataError


def companion_file(folder: Path, name: str, stated_in: str) -> Path:
    """Return the path of a file that another one names, relative to its `folder`.

    `stated_in` is the name of the file that names it, for messages. Raises DataError if the name is
    absolute or leads out of the folder, also by a link: a file from somebody else must not choose
    what is read from this computer.
    """
    path = folder / name
    given = PureWindowsPath(name)  # also knows / as a separator, and drives
    inside = name.strip() and not given.is_absolute() and not given.drive and not given.root
    if not inside or ".." in given.parts or "\x00" in name or not _within(path, folder):
        raise DataError(
            f"{stated_in} names the file {name!r}; expected a file in its folder or a folder in it: "
            "move the file there, and correct the entry."
        )
    return path


def _within(path: Path, folder: Path) -> bool:
    try:
        return path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # a circle of links
        return False
