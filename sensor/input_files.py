"""Files named in a sensor's description."""

from pathlib import Path

from megalopta.core.bounded import ARRAY_BYTES, read_bytes
from megalopta.core.errors import DamagedFileError


def file_content(path: str | Path, field: str) -> bytes:
    """Return the content of a file.

    Raises ValueError if it cannot be read; names the field that refers to it.
    """
    try:
        return read_bytes(path, ARRAY_BYTES)
    except OSError as problem:
        reason = (problem.strerror or str(problem)).lower()
        raise ValueError(f"{field}: {path} cannot be read ({reason}); give a file's path") from None
    except DamagedFileError as problem:
        raise ValueError(f"{field}: {problem}") from None
    except ValueError:  # a null byte
        raise ValueError(f"{field}: {str(path)!r} is not a path; give a file's path") from None
