"""Every error this package raises on purpose.

SteeredMarigoldError
├── InputError (ValueError)          the caller's data or arguments
│   ├── FileFormatError              a file that is missing, damaged, or of the wrong kind
│   ├── SizeMismatchError            arrays that must share a size and do not
│   └── NoMeasurementsError          a metric answer was asked for, and nothing was measured
├── CheckpointError (ValueError)     weights that are missing, incomplete or unsafe to load
└── MissingExtraError (ImportError)  an optional dependency is not installed

Each message names the file or argument, says what was wrong and what to do. The command line
exits with 2 on InputError and CheckpointError, with 1 on the others.
"""


class SteeredMarigoldError(Exception):
    """Base of all errors of this package."""


class InputError(SteeredMarigoldError, ValueError):
    """The caller's data or arguments cannot be used."""


class FileFormatError(InputError):
    """A file is missing, damaged, or of a kind that cannot hold what it must."""


class SizeMismatchError(InputError):
    """Arrays that must share a size do not."""


class NoMeasurementsError(InputError):
    """A metric answer was asked for, and nothing was measured."""


class CheckpointError(SteeredMarigoldError, ValueError):
    """Weights are missing, incomplete or unsafe to load."""


class MissingExtraError(SteeredMarigoldError, ImportError):
    """An optional dependency is not installed."""

    def __init__(self, extra: str, module: str) -> None:
        super().__init__(
            f"{module} is not installed; get it with: pip install 'steered-marigold[{extra}]'"
        )
        self._arguments = extra, module

    def __reduce__(self) -> tuple[type["MissingExtraError"], tuple[str, str]]:
        """Pickled, for other processes, as it was made."""
        return type(self), self._arguments
