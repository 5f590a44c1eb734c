"""Help on one screen: one sentence per usual option; ``--help-expert`` shows everything."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cyclopts.help import DefaultFormatter, HelpEntry, HelpPanel, InlineText
from rich.markdown import Markdown
from rich.text import Text

from phasestereo import _core

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions

EXPERT = "--help-expert"
"""The flag that shows everything."""

_SELDOM = frozenset(
    (
        *("flags-output", "confidence-output", "uncertainty-output"),
        *("left-mask", "right-mask", "bands", "device", "noise", "timeout"),
        *("doffs", "cx", "cy", "min-depth", "max-depth", "decimate", "yaw", "anchor"),
        *("depth-scale", "register", "register-size"),
        *("truth-scale", "truth-mask", "truth-mask-level"),
    )
)
_SETTINGS = frozenset(setting.name.replace("_", "-") for setting in _core.SETTINGS)
_HIDDEN = frozenset(f"--{name}" for name in _SELDOM | _SETTINGS)


class Help(DefaultFormatter):
    """Shows the panels of a command's help, whole or shortened."""

    whole = False
    left_out = 0

    def __call__(self, console: Console, options: ConsoleOptions, panel: HelpPanel) -> None:
        """Print a panel, unless all of it is hidden."""
        if self.whole or panel.format == "command":
            super().__call__(console, options, panel)
            return

        shown = [entry for entry in panel.entries if not _HIDDEN.intersection(entry.names)]
        entries = [entry.copy(description=_shortened(entry)) for entry in shown]
        if entries:
            super().__call__(console, options, panel.copy(entries=entries, description=None))
        self.left_out += len(panel.entries) - len(shown)


def _shortened(entry: HelpEntry) -> Any:
    """Return the first sentence of an option's description, and the rest unchanged."""
    said = entry.description
    if not isinstance(said, InlineText) or not isinstance(said.primary_renderable, Markdown):
        return said

    sentence, _, _ = said.primary_renderable.markup.replace("\n", " ").partition(". ")
    return Text(sentence.removesuffix(".").replace("``", "") + ".")
