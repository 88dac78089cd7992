"""One exception tree; every message says what was expected, what was found, where, what to do."""

INTERRUPTED, INTERRUPTION = 130, "vnav: interrupted; what was finished is kept"  # code, and words
MEND = "build the map anew with 'vnav build-map CAPTURE --fresh'"  # what to do of a damaged map


class VnavError(Exception):
    """Something a user can mend; the command line prints it as one line and exits with 1."""


def notes_of(error: BaseException) -> tuple[str, ...]:
    """What an error proposes besides its one line, such as a file to save (PEP 678)."""
    return tuple(getattr(error, "__notes__", ()))


class ConfigError(VnavError):
    """A setting, preset or configuration file is unknown or impossible."""


class CaptureError(VnavError):
    """A capture folder, or a frame of it, cannot be used."""


class CameraError(VnavError):
    """A camera description is missing, incomplete or impossible."""


class MapError(VnavError):
    """A map folder is missing, damaged, of another format or not writable."""


class StaleArtifact(MapError):  # noqa: N818 - the name is the state it reports
    """A stage is missing or older than what it was made from; names the command to run."""


class PhotoError(VnavError):
    """A photo cannot be read."""


class TrajectoryError(VnavError):
    """A trajectory file cannot be read, or too little of it can be compared."""


class DatasetError(VnavError):
    """A public sequence is unknown, cannot be fetched, or is not what it was."""
