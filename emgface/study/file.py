"""Read and check study.toml, and resolve its paths."""

import tomllib
from pathlib import Path

from emgface.choices import Parameters, configure
from emgface.errors import ConfigurationError
from emgface.study.axes import absolute_paths
from emgface.study.configuration import StudyConfiguration
from emgface.study.exclusions import check_exclusions, read_exclusions
from emgface.study.variants import check_axes


def load_study(path: Path) -> StudyConfiguration:
    """Read study.toml, with paths relative to its folder made absolute and its file of exclusions.

    Raises ConfigurationError if the file is missing or is not TOML, a parameter is unknown (with
    the nearest valid name) or a value is out of range.
    """
    try:
        values = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(
            f"{path} cannot be read ({error.strerror}): write one with 'emgface study template'"
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path} is not valid TOML: {error}") from error
    study = configure(StudyConfiguration, values, where=path.name)
    base = path.resolve().parent

    def absolute(given: Parameters, *names: str) -> Parameters:
        paths = {name: getattr(given, name) for name in names}
        return given.model_copy(update={k: base / v for k, v in paths.items() if v is not None})

    named = ("folder", "mapping", "reference_folder", "exclusions")
    recordings = absolute(study.recordings, *named)
    exclude = check_exclusions(study.exclude, where=path.name)
    if study.recordings.exclusions is not None:
        exclude += read_exclusions(base / study.recordings.exclusions)
    study = study.model_copy(
        update={
            "recordings": recordings,
            "face": absolute(study.face, "path", "head"),
            "tract": study.tract and absolute(study.tract, "areas"),
            "simulation": study.simulation.model_copy(
                update={"reduced": absolute(study.simulation.reduced, "file")}
            ),
            "exclude": exclude,
            "axis": absolute_paths(study.axis, base),
        }
    )
    check_axes(study, where=path.name)
    return study
