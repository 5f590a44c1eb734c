"""Optional dependencies: imported on first use; the error names the command that installs them."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def require(module: str, *, extra: str, of: str = "phasestereo") -> Any:
    """Import an optional dependency.

    Parameters
    ----------
    module
        Dotted name of the module to import.
    extra
        The extra that installs it.
    of
        The distribution that has the extra.

    Raises
    ------
    ImportError
        If the module is not installed; the message is the command that installs it.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name is None or module.split(".", maxsplit=1)[0] != error.name.split(".")[0]:
            raise
        raise ImportError(
            f"{error.name} is not installed; it comes with: pip install '{of}[{extra}]'"
        ) from error
