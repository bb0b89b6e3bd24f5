"""Read and check study.toml, and resolve its paths."""

from pathlib import Path

from emgface.choices import configure
from emgface.errors import ConfigurationError
from emgface.study.configuration import StudyConfiguration
from emgface.study.exclusions import check_exclusions, read_exclusions
from emgface.study.paths import with_paths
from emgface.study.variants import check_axes
from emgface.texts import read_toml


def load_study(path: Path) -> StudyConfiguration:
    """Read study.toml, with paths relative to its folder made absolute and its file of exclusions.

    Raises ConfigurationError if the file is missing or is not TOML, a parameter is unknown (with
    the nearest valid name) or a value is out of range.
    """
    if not path.is_file():
        raise ConfigurationError(
            f"{path} cannot be read (no such file): write one with 'emgface study template'"
        )
    study = configure(StudyConfiguration, read_toml(path), where=path.name)
    base = path.resolve().parent

    exclude = check_exclusions(study.exclude, where=path.name)
    study = with_paths(study, lambda given: base / given)
    if study.recordings.exclusions is not None:
        exclude += read_exclusions(study.recordings.exclusions)
    study = study.model_copy(update={"exclude": exclude})
    check_axes(study, where=path.name)
    return study
